"""Every fault with the function that sees it, one module for each thing that can fail.

Bounds are written ``lo <= x <= hi``, so that NaN fails them.
"""
