"""Make towns, vehicles and materials as USD assets, import those of other tools, and check them."""
