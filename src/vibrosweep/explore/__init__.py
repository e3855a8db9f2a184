"""A page that shows a result as points of a plane, and the motion behind each point.

`points`, `choice`, `pictures`, `curves`, `raster`, `python_lines` and `table` compute numbers and
text from results and parameters, without Bokeh; `live`, `server` and `static` display them with
Bokeh, which the extra ``explore`` installs.
"""
