"""How Sphinx builds the documentation: the pages of this folder, and the reference from the docstrings."""

from importlib.util import find_spec

project = "sma_actuator"
copyright = "sma_actuator developers"  # noqa: A001 - Sphinx wants this name
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx.ext.apidoc",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build"]
html_theme = "sphinx_rtd_theme"
html_static_path: list[str] = []

apidoc_modules = [
    {
        "path": f"../{package}",
        "destination": f"api/{package}",
        "max_depth": 4,
        "separate_modules": True,
        "include_private": False,
    }
    for package in ("sma_actuator", "sma_msgs_py")
]
autodoc_default_options = {"members": True, "undoc-members": False, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_preserve_defaults = True
# Without ROS 2 the reference is built all the same.
autodoc_mock_imports = [name for name in ("rclpy", "pymeasure") if find_spec(name) is None]
myst_heading_anchors = 3
# Fields of a frozen dataclass are described twice, by the class and by its comments.
suppress_warnings = ["autodoc.mocked_object", "ref.python"]
