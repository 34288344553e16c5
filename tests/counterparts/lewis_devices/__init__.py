"""Devices in lewis' framework, where lewis has none packaged."""
