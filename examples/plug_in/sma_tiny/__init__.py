"""Parts that sma_actuator finds by their entry points; see pyproject.toml beside this package."""
