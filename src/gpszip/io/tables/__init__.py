"""Tables as logs: the roles of columns, conventions of notation, times and positions."""
