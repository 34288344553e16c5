"""The physics of a wire under load: heat, transformation, strain, resistance."""
