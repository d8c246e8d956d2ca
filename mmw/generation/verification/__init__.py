"""What `mmw verify` looks at beside files and hashes: counts against the plan, physics, rows that are made again."""
