"""TwinCAT NC: tables of a PLC program."""
