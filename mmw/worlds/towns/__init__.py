"""Towns: a declarative YAML description becomes a lane graph and USD geometry."""
