"""The specification of every table, by what it describes."""
