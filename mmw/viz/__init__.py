"""Draw datasets: plots, stills, an HTML report and the Rerun viewer."""
