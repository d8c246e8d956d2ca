"""Show a finished dataset in the Rerun viewer (extra `viz`)."""
