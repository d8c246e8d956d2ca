"""Find the propagation paths between transmitters and receivers."""
