"""A page that shows a result as points of a plane, and the motion behind each point.

`points`, `choice`, `pictures`, `curves`, `raster`, `python_lines` and `table` are plain functions
from results and parameters to numbers and text; `live`, `server` and `static` display these with
Bokeh, which the extra ``explore`` installs.
"""
