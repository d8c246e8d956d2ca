"""Worlds from other tools: each reader returns a `ImportedScene`, which becomes an ordinary town asset."""
