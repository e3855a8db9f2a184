"""The command that explores a result: its messages."""

import sys

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


def test_a_port_that_is_taken_is_told(swept, capsys):
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["explore", str(swept), "--port", str(port)]) == 2
    assert f"port {port} cannot be had" in capsys.readouterr().err
