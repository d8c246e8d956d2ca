"""Run the commands of `mmw`."""
