"""Store datasets: schemas of the tables; writing, listing and verifying shards; local folders and S3 buckets."""
