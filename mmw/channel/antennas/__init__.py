"""Model antenna patterns and arrays."""
