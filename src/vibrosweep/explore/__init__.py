"""A page on which a result is looked at: its plane, and behind every point of it the motion.

`points`, `choice`, `pictures`, `curves`, `raster`, `python_lines` and `table` are plain functions
from results and parameters to numbers and text; `live`, `server` and `static` show these with
Bokeh, which the extra ``explore`` installs.
"""
