"""Settings of the documentation site, built by `make docs` from what `site/gather.py` gathers."""

import sys
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "site"))

project = html_title = "dancediff"
extensions = ["myst_nb", "sphinx.ext.viewcode", "mathml"]

myst_enable_extensions = ["colon_fence", "dollarmath", "fieldlist"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # the outputs stored in the lessons are shown
nb_merge_streams = True
nb_ipywidgets_js = {}  # would be fetched when a page is opened

html_theme = "furo"
FONT = Path(find_spec("ziamath").origin).parent / "fonts" / "STIXTwoMath-Regular.ttf"
html_static_path = ["site/style.css", str(FONT)]
html_css_files = ["style.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_copyright = False

add_module_names = False
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
