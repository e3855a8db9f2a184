"""Every command of the README and of docs/start.md is tried by checks/page_commands.py."""

import pytest

import page_commands
from page_commands import PAGES, ROOT, Step, all_steps, steps
from vibrosweep.commands import COMMANDS

PAGE = """
```sh
python -m pip install . && vibrosweep run a.toml
vibrosweep info a.h5
```
`vibrosweep one SPEC.toml` or `--two N` needs (`pip install '.[verify]'`). `python -m three` not.

| `vibrosweep four` | does this |
| `vibrosweep five` | does that (needs `pip install '.[explore]'`) |

```python
print(1)
```
```sh
python -m pip install '.[docs]' && python -m six
```
"""


def test_commands_and_what_is_installed_for_them():
    assert [one[1:] for one in steps("page", PAGE)] == [
        ("", "vibrosweep run a.toml"),
        ("", "vibrosweep info a.h5"),
        ("verify", "vibrosweep one SPEC.toml"),
        ("verify", "--two N"),
        ("", "python -m three"),
        ("", "vibrosweep four"),
        ("explore", "vibrosweep five"),
        ("docs", "python -m six"),
        ("", "python -c 'print(1)\n'"),
    ]


def test_every_command_of_the_pages_is_tried():
    tried = [one.command.split() for one in all_steps()]
    assert {words[1] for words in tried if words[0] == "vibrosweep"} >= set(COMMANDS)
    assert Step("README.md", "docs", "python -m sphinx -W docs build/site") in all_steps()
    for page in PAGES:
        text = (ROOT / page).read_text("utf-8")
        assert text.count("pip install ") == len(page_commands.INSTALL.findall(text))


def test_a_new_command_cannot_be_forgotten(monkeypatch, tmp_path):
    monkeypatch.setattr(page_commands, "ROOT", tmp_path)
    monkeypatch.setattr(page_commands, "PAGES", ("new.md",))
    (tmp_path / "new.md").write_text("`vibrosweep shake SPEC.toml`\n")
    with pytest.raises(SystemExit, match=r"FILLED for: new.md: vibrosweep shake SPEC.toml"):
        all_steps()
