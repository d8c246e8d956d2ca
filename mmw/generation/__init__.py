"""Generate datasets: plan, run, resume, verify and regenerate; replay frames in memory."""
