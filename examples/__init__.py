"""Examples that use mmw as its users do; they are not part of the package."""
