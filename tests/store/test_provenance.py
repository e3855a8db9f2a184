from pathlib import Path

from vibrosweep.store import writing as module


def test_without_a_repository_there_is_no_revision(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "__file__", str(tmp_path / "a" / "b" / "c" / "d.py"))
    assert "git_revision" not in module.provenance(1)


def test_the_revision_is_that_of_the_branch(monkeypatch, tmp_path):
    git = tmp_path / ".git"
    (git / "refs" / "heads").mkdir(parents=True)
    monkeypatch.setattr(module, "__file__", str(tmp_path / "src" / "package" / "store" / "d.py"))
    (git / "HEAD").write_text("ref: refs/heads/main\n")
    assert "git_revision" not in module.provenance(1)  # its refs are packed
    (git / "refs" / "heads" / "main").write_text("12ab\n")
    assert module.provenance(1)["git_revision"] == "12ab"
    (git / "HEAD").write_text("34cd\n")  # no branch
    assert module.provenance(1)["git_revision"] == "34cd"


def test_a_system_without_cpuinfo_still_names_a_processor(monkeypatch):
    def read(path, **options):
        if path == Path("/proc/cpuinfo"):
            raise FileNotFoundError
        return original(path, **options)

    original = Path.read_text
    monkeypatch.setattr("pathlib.Path.read_text", read)
    assert module.provenance(3)["cpu"]
