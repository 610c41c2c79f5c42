"""Studies that use the library; nothing imports them."""
