"""Files of others: what is opened, and what is refused before anything is read."""

import os

import pytest

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import SETTINGS, FileLimit
from uavbench.trajectories.files.reading import read_bytes, read_json, read_text, read_toml

FEW = FileLimit("note", 10, "write less")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "note").write_text("hello")
    (tmp_path / "secret").write_text("secret")
    return tmp_path / "inner"


def test_a_regular_file_is_read_and_links_within_its_folder_are_followed(folder):
    (folder / "link").symlink_to("note")
    for name in ("note", "link"):
        assert read_text(folder / name, FEW, inside=folder) == "hello"


@pytest.mark.parametrize("target", ["../secret", "/etc/hostname", "sub/secret"])
def test_what_lies_outside_is_refused(folder, target):
    (folder / "sub").symlink_to(folder.parent)
    (folder / "link").symlink_to(target)
    with pytest.raises(UserError, match="link: points outside the folder"):
        read_bytes(folder / "link", SETTINGS, inside=folder)


def test_pipes_devices_and_folders_are_refused_at_once(folder):
    os.mkfifo(folder / "pipe")
    (folder / "zero").symlink_to("/dev/zero")
    for name in ("pipe", "zero", "."):
        with pytest.raises(UserError, match="not a regular file"):
            read_bytes(folder / name, SETTINGS)


def test_a_file_that_is_swapped_for_a_pipe_after_it_was_looked_at_is_refused(folder, monkeypatch):
    os.mkfifo(folder / "pipe")
    real = os.open
    monkeypatch.setattr(os, "open", lambda path, flags: real(folder / "pipe", flags))
    with pytest.raises(UserError, match="not a regular file"):
        read_bytes(folder / "note", SETTINGS)


def test_a_file_over_its_limit_is_refused_by_its_size(folder):
    with (folder / "huge").open("wb") as handle:
        handle.truncate(1 << 40)
    with pytest.raises(UserError, match=r"has 1,099,511,627,776 bytes; a note has at most 10: write less"):
        read_bytes(folder / "huge", FEW)


def test_a_file_of_the_limit_is_read_and_one_that_grows_beyond_it_is_not(folder, monkeypatch):
    (folder / "note").write_bytes(b"0123456789")
    assert read_bytes(folder / "note", FEW) == b"0123456789"
    real = os.fstat

    def grown(handle):
        found = real(handle)
        with (folder / "note").open("ab") as more:
            more.write(b"0")
        return found

    monkeypatch.setattr(os, "fstat", grown)
    with pytest.raises(UserError, match="a note has at most 10"):
        read_bytes(folder / "note", FEW)


def test_lines_end_as_on_unix(folder):
    (folder / "note").write_bytes(b"a\r\nb\rc\n\n")
    assert read_text(folder / "note") == "a\nb\nc\n\n"


def test_missing_files_bad_names_and_loops_are_told(folder):
    (folder / "loop").symlink_to("loop")
    for name, told in (("no", "no such file, really"), ("a\0b", "cannot be read"), ("loop", "cannot be read")):
        with pytest.raises(UserError, match=told):
            read_bytes(folder / name, FEW, hint=", really")


def test_tables_and_objects_are_read_as_deep_as_the_limit(folder):
    deep = '{"a": ' * 63 + '{"b": [1]}' + "}" * 63
    (folder / "a.json").write_text('\ufeff{"width": 640, "names": ["x", null]}')
    (folder / "a.toml").write_text('width = 640\r\n[camera]\nname = "x"\n')
    assert read_json(folder / "a.json") == {"width": 640, "names": ["x", None]}
    assert read_toml(folder / "a.toml") == {"width": 640, "camera": {"name": "x"}}
    (folder / "deep.json").write_text(deep)
    with pytest.raises(UserError, match="nested deeper than 64 levels"):
        read_json(folder / "deep.json")
    (folder / "deep.json").write_text(deep.replace("[1]", "1"))
    assert read_json(folder / "deep.json")["a"]


def test_what_is_no_text_is_told(folder):
    (folder / "note").write_bytes(b"ab\xff")
    with pytest.raises(UserError, match=r"not readable as text: .* at byte 2"):
        read_text(folder / "note")


@pytest.mark.parametrize(
    "text", ["x = " + "[" * 90_000, "x = " + "{a=" * 500, "x = " + "[" * 100 + "]" * 100, "x" + ".x" * 5000 + " = 1",
             "x" + ".x" * 500_000 + " = 1", "[" + '"x" . ' * 500_000 + "x]", "x" * 2_000_000]
)  # fmt: skip
def test_deep_toml_is_told(folder, text):
    (folder / "deep.toml").write_text(text)
    with pytest.raises(UserError, match=r"deep.toml: not a readable TOML file: "):
        read_toml(folder / "deep.toml")


@pytest.mark.parametrize("text", ["[" * 90_000, '{"a":' * 90_000, '{"a":' * 100 + "1" + "}" * 100, "[]", "3", "null"])
def test_deep_json_and_what_is_no_object_are_told(folder, text):
    (folder / "deep.json").write_text(text)
    with pytest.raises(UserError, match=r"deep.json: .*(nested deeper than 64 levels|expected a JSON object)"):
        read_json(folder / "deep.json")
