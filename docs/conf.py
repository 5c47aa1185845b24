"""Sphinx settings: Markdown pages by MyST, the reference from the docstrings."""

project = "tactilevision"
author = "The tactilevision developers"
copyright = "2026, the tactilevision developers"  # noqa: A001 - Sphinx fixes the name
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
html_theme = "alabaster"
html_theme_options = {"description": "Mechanics you can trust from vision-based tactile sensors"}
autodoc_typehints = "description"
exclude_patterns = ["_build"]
