"""Furukawa NT-H (Ni-Ti-Cu): polynomial curves in resistance (thesis, 5.2)."""
