"""A page that shows a result as points of a plane, and the motion behind each point.

`points`, `pictures` and `words` compute numbers and text from results and parameters, without
Bokeh; `views`, `live`, `server` and `static` display them with Bokeh, which the extra ``explore``
installs.
"""

from __future__ import annotations

import html
import os
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vibrosweep.errors import VibrosweepError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Explorer", "MissingBokehError", "explore", "require_bokeh"]

# Pages that may show the page in a frame: notebooks on this machine
NOTEBOOKS: Final = ("http://localhost:*", "http://127.0.0.1:*")
HUB: Final = "JUPYTERHUB_SERVICE_PREFIX"  # set by JupyterHub
FRAME: Final = 'width="100%" height="900" style="border: 0"'
BEHIND_A_HUB: Final = (
    "<p>Behind JupyterHub your browser cannot reach the machine of the notebook, so that this is "
    "the page in a file, with a sample of motions and no sliders. On your own machine, "
    "<code>vibrosweep explore</code> shows the whole page.</p>"
)


class MissingBokehError(VibrosweepError, ImportError):
    """The page needs bokeh, which is not installed."""


def require_bokeh() -> None:
    """Raise a MissingBokehError if bokeh is not installed."""
    try:
        import bokeh  # noqa: F401
    except ImportError as error:
        raise MissingBokehError(
            'the page is made with bokeh, which is not installed: pip install "vibrosweep[explore]"'
        ) from error


class Explorer:
    """The page of a result, which a notebook shows as the value of a cell.

    Attributes
    ----------
    address
        Where a browser on this machine finds the page; empty behind JupyterHub.
    """

    def __init__(self, shown: str, address: str = "") -> None:
        self._shown = shown
        self.address = address

    def __repr__(self) -> str:
        return f"Explorer({self.address!r})"

    def _repr_html_(self) -> str:
        return self._shown


def explore(result: str | os.PathLike[str] | xr.Dataset, *, port: int = 0) -> Explorer:
    """Look at a result, and at the motion behind every point of it.

    In a notebook the page is shown below the cell; elsewhere it opens in the browser.  It is served
    until Python ends; in a script, until Ctrl-C.  Behind JupyterHub, where a browser cannot
    reach the machine of the notebook, a page without a server is shown instead, which holds a
    sample of motions.

    Parameters
    ----------
    result
        The path of a result of `run`, `windows`, `bifurcation`, `basins`, `orbits` or `branches`,
        or the dataset that such a function returns.
    port
        Port on this machine; 0, the default, chooses a free one.

    Returns
    -------
    Explorer
        The page; its ``address`` is for browsers on this machine.

    Raises
    ------
    ImportError
        Bokeh is not installed: ``pip install "vibrosweep[explore]"``.
    DataError
        The file cannot be read, or the result has no points of a plane.
    RunError
        The port is not free.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.sweep(restitution=(0.8, 0.95), realizations=20, separation=True, progress=False)
    >>> page = vs.explore(found)  # doctest: +SKIP
    """
    require_bokeh()
    from vibrosweep.explorer.points import open_points, points_of

    if isinstance(result, str | os.PathLike):
        points = open_points(Path(result))
    else:
        points = points_of(result)
    if HUB in os.environ:
        from vibrosweep.explorer.static import page_text

        page = html.escape(page_text(points, "the page")[0])
        return Explorer(f'{BEHIND_A_HUB}<iframe srcdoc="{page}" {FRAME}></iframe>')
    from vibrosweep.explorer.server import serve, serve_beside

    if not _interactive():
        addresses: list[str] = []
        serve(points, port, lambda address: _open(points.title, address, addresses))
        return Explorer("", addresses[0])
    address = serve_beside(points, port, NOTEBOOKS)
    if not _in_notebook():
        _open(points.title, address, [])
    link = f'<a href="{address}" target="_blank">{address}</a>'
    return Explorer(f'{link}<iframe src="{address}" {FRAME}></iframe>', address)


def _open(title: str, address: str, addresses: list[str]) -> None:
    """Say where the page is, and open it in the browser."""
    addresses.append(address)
    print(f"{title}: {address}", flush=True)
    webbrowser.open(address)


def _shell() -> str:
    """Name of the class of the shell of IPython; empty if there is none."""
    ipython = sys.modules.get("IPython")
    return "" if ipython is None else type(ipython.get_ipython()).__name__


def _in_notebook() -> bool:
    return _shell() == "ZMQInteractiveShell"


def _interactive() -> bool:
    return hasattr(sys, "ps1") or _shell().endswith("InteractiveShell")
