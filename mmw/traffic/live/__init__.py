"""Traffic that is stepped live: controls of vehicles, causal filters, obstacles off the lanes."""
