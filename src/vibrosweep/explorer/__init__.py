"""A page that shows a result as points of a plane, and the motion behind each point.

`points`, `pictures` and `words` compute numbers and text from results and parameters, without
Bokeh; `views`, `live`, `server` and `static` display them with Bokeh, which the extra ``explore``
installs.
"""
