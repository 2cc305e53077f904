"""Tables and grids of volid itself, for programs that read them."""
