"""Sphinx settings: Markdown pages, a gallery that runs the examples, and the API from both packages' `__all__`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

DOCS = Path(__file__).parent
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small problems wait for threads otherwise
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext")]

project = "tactilevision"
author = "The tactilevision developers"
copyright = "2026, the tactilevision developers"  # noqa: A001 - Sphinx fixes the name
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "public_names",
    "effects_table",
    "plain_docstrings",
    "mathml",
]
html_math_renderer = "mathml"
exclude_patterns = ["_build", "gallery/README.rst", "sg_execution_times.rst", "**/sg_execution_times.rst"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_fence_as_directive = ["math"]  # ```math, as other readers of Markdown know it
myst_heading_anchors = 4
highlight_language = "none"  # blocks without a language are command lines
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autosummary_generate = False
python_use_unqualified_type_names = True
maximum_signature_line_length = 90

sphinx_gallery_conf = {
    "examples_dirs": str(DOCS.parent / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "ExampleTitleSortKey",
    "remove_config_comments": True,
    "show_memory": False,
    "download_all_examples": False,
    "min_reported_time": 5,
    "abort_on_example_error": True,
    "plot_gallery": True,
    "image_srcset": ["2x"],
    "reset_modules": ("matplotlib", "example_file.set_file"),
}

html_theme = "pydata_sphinx_theme"
html_title = "tactilevision"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "tactilevision"},
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 8,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars = {"index": [], "format": []}
