"""File names of a config: where they start, and which lead out of its folder."""

import pytest

from uavbench.bench.inputs.file_paths import FREE, is_file, located, names_a_file


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A config's folder with two files, and one beside it."""
    monkeypatch.delenv(FREE, raising=False)
    here = tmp_path / "here"
    (here / "sub").mkdir(parents=True)
    for path in (here / "run.py", here / "sub" / "a.obj", tmp_path / "far.obj"):
        path.write_text("1")
    return here


def test_keys_name_files_by_their_names():
    assert [key for key in ("file", "path", "a_file", "a_path", "files", "filename", "pathway", "command") if
            names_a_file(key)] == ["file", "path", "a_file", "a_path"]  # fmt: skip


def test_names_start_at_the_folder_of_their_config_however_deep(folder):
    config = {
        "path": "sub/a.obj",
        "title": "sub/a.obj",
        "number": 3,
        "file": 4,
        "parts": [{"texture_file": "no.png"}, "run.py", [{"path": "b"}]],
        "input_files": ["run.py", "no.py", 5],
        "deep": {"command": ["python", "run.py", "no.py", 6], "input_files": "run.py"},
        "command": "run.py",
    }
    found = located(config, folder)
    assert found.outside == []
    assert found.config == {
        "path": str(folder / "sub/a.obj"),
        "title": "sub/a.obj",
        "number": 3,
        "file": 4,
        "parts": [{"texture_file": str(folder / "no.png")}, "run.py", [{"path": str(folder / "b")}]],
        "input_files": [str(folder / "run.py"), "no.py", 5],
        "deep": {"command": ["python", str(folder / "run.py"), "no.py", 6], "input_files": "run.py"},
        "command": "run.py",
    }
    assert located(7, folder) == (7, [])


def test_every_name_that_leads_out_is_told_with_its_key(folder):
    far = folder.parent / "far.obj"
    config = {
        "a": {"path": "../far.obj"},
        "b": [{"file": "run.py"}, {"file": str(far)}],
        "input_files": ["run.py", "../far.obj", 5],
        "command": [str(far), "../far.obj"],
    }
    found = located(config, folder)
    assert [line.split(": ")[0] for line in found.outside] == ["a.path", "b[1].file", "input_files"]
    for line, name in zip(found.outside, ("../far.obj", far, "../far.obj"), strict=True):
        assert line.split(": ", 1)[1] == (
            f"{name} lies outside of {folder.resolve()}, the folder of this file; copy it there, or allow its own: "
            f"{FREE}={far.parent}"
        )
    assert found.config["a"]["path"] == str(folder / "../far.obj")


def test_folders_that_are_allowed_may_be_named(folder, monkeypatch):
    config = {"path": "../far.obj"}
    for allowed, outside in (("", 1), (str(folder), 1), (f"/none:{folder.parent}", 0)):
        monkeypatch.setenv(FREE, allowed)
        assert len(located(config, folder).outside) == outside


def test_links_of_a_folder_are_followed_and_three_of_them_told(folder):
    many = folder / "many"
    (many / "deep").mkdir(parents=True)
    (many / "inside").symlink_to(folder / "run.py")
    assert located({"path": "many"}, folder).outside == []
    for k in range(5):
        (many / "deep" / f"link{k}").symlink_to(folder.parent / f"far{k}")
    lines = located({"path": "many"}, folder).outside
    assert len(lines) == 3
    assert all(line.startswith(f"path: {folder.parent / 'far'}") for line in lines)


def test_a_link_outside_of_a_named_folder_is_not_of_it(folder):
    (folder / "other").mkdir()
    (folder / "other" / "link").symlink_to(folder.parent / "far.obj")
    assert located({"path": "sub"}, folder).outside == []
    assert len(located({"path": "other"}, folder).outside) == 1


def test_what_can_be_no_name_of_a_file_is_told_and_is_none(folder):
    (line,) = located({"path": "a\0b"}, folder).outside
    assert line.startswith("path: 'a\\x00b' is not a file name: ")
    for name in ("a\0b", "x" * 5000):
        assert not is_file(folder / name)
    assert is_file(folder / "run.py") and not is_file(folder) and not is_file(folder / "none")
