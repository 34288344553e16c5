"""From measured signals to displacement: circuit, branch, strain models, effects."""
