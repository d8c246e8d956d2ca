"""Where the work runs: the device, later the executors."""
