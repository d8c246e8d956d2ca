"""Generate datasets: plan, run, resume, verify and regenerate."""
