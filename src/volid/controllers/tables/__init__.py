"""Tables as controls hold them: equal steps, positions counted from zero, increments of whole quanta, lists."""
