"""The command that explores a result: its messages."""

import os
import shutil
import sys

import h5py
import numpy as np
import pytest

from vibrosweep.cli import main


@pytest.fixture
def swept(compute):
    return compute("[sample]\nrestitution = [0.8, 0.9]\nrealizations = 2\n")


def test_a_missing_package_is_named_with_the_command_that_installs_it(swept, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    assert main(["explore", str(swept)]) == 2
    assert 'pip install "vibrosweep[explore]"' in capsys.readouterr().err


def test_a_page_is_written(swept, tmp_path, capsys):
    page = tmp_path / "page.html"
    assert main(["explore", str(swept), "-o", str(page)]) == 0
    assert f"written to {page}" in capsys.readouterr().out
    assert main(["explore", str(swept), "-o", str(page)]) == 2
    assert "exists and is kept" in capsys.readouterr().err


def test_a_taken_port_is_reported(swept, capsys):
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["explore", str(swept), "--port", str(port)]) == 2
    assert f"port {port} is not available" in capsys.readouterr().err


@pytest.mark.parametrize("port", ["99999", "65536", "-1", "x"])
def test_a_number_that_is_no_port_is_reported(swept, capsys, port):
    with pytest.raises(SystemExit) as ended:
        main(["explore", str(swept), f"--port={port}"])
    assert ended.value.code == 2
    assert "at least 0 and at most 65535" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt" or sys.platform == "darwin", reason="names there are Unicode")
def test_names_that_are_not_unicode_can_be_read_and_written(swept, tmp_path):
    """Names of a result and of a page, and a title that another program wrote."""
    odd = tmp_path / os.fsdecode(b"\xff.h5")
    page = tmp_path / os.fsdecode(b"\xff.html")
    with_title(swept, odd, b"\xfftitle")
    assert main(["explore", str(odd), "-o", str(page)]) == 0
    assert "title" in page.read_text("utf-8")
    assert main(["figures", str(odd), "-o", str(tmp_path / os.fsdecode(b"\xff"))]) == 0
    assert main(["info", str(odd)]) == 0


def with_title(source, target, title):
    """Save a result again with another title."""
    shutil.copy(source, target)
    with h5py.File(target, "r+") as file:
        file.attrs.create("title", np.bytes_(title), dtype=h5py.string_dtype())


@pytest.mark.parametrize(
    "origin",
    [
        "hub",
        "hub.example.org",
        "https://",
        "https://a.org/b",
        "https://a.org; x",
        "*",
        "http://a b",
        "",
    ],
)
def test_an_origin_that_is_none_is_refused_in_words(origin, swept, capsys):
    """It would end up in a header of every answer."""
    with pytest.raises(SystemExit) as ended:
        main(["explore", str(swept), "--frame-in", origin])
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert "--frame-in" in message
    assert "such as https://hub.example.org" in message
