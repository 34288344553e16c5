"""Bench logs: read, written by the node, taken from bags."""
