"""What the list of a folder proves: that a name stands for the very bytes or link that was written under it."""

import json
import os
import threading

import pytest

from uavbench.trajectories.files.listed import Listed, Marker, mark, tree
from uavbench.trajectories.files.seals import is_sealed, is_sealed_with, seal

LIST = Marker("list.json", "list")
MARKER = LIST.name


@pytest.fixture
def made(tmp_path):
    """A folder with a plain file, a sealed one, one further down and a link, and their list."""
    folder = tmp_path / "made"
    (folder / "deep").mkdir(parents=True)
    (folder / "a.csv").write_text("1\n")
    (folder / "deep" / "b.csv").write_text("2\n")
    (folder / "page.html").write_text("<html></html>\n")
    seal(folder / "page.html", LIST.kind)
    (folder / "latest").symlink_to("a.csv")
    mark(folder, LIST)
    return folder


def held(folder, *names):
    listed = Listed.of(folder, LIST)
    return [listed.holds(folder, name) for name in names or ("a.csv", "deep/b.csv", "page.html", "latest")]


def test_what_was_listed_is_held_as_it_is_and_nothing_else(made):
    assert is_sealed(made / MARKER)
    assert list(tree(made)) == ["a.csv", "deep/b.csv", "latest", MARKER, "page.html"]
    assert held(made) == [True] * 4
    (made / "c.csv").write_text("1\n")
    assert held(made, "c.csv", "none.csv", "deep", MARKER) == [False] * 4


def test_a_link_to_a_folder_is_a_name_and_is_not_followed(tmp_path):
    (tmp_path / "far" / "deep").mkdir(parents=True)
    (tmp_path / "far" / "deep" / "thesis.tex").write_text("mine")
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "link").symlink_to(tmp_path / "far")
    assert list(tree(tmp_path / "made")) == ["link"]
    mark(tmp_path / "made", LIST)
    assert held(tmp_path / "made", "link", "link/deep/thesis.tex") == [True, False]


@pytest.mark.parametrize("name", ["a.csv", "deep/b.csv", "page.html"])
@pytest.mark.parametrize("what", ["edited", "removed", "a link to the same bytes", "a folder"])
def test_a_file_is_held_no_more_once_something_else_stands_there(made, name, what):
    path = made / name
    data = path.read_bytes()
    path.unlink()
    if what == "edited":
        path.write_bytes(data.replace(b"\n", b" \n", 1))
    elif what == "a link to the same bytes":
        (made.parent / "far").write_bytes(data)
        path.symlink_to(made.parent / "far")
    elif what == "a folder":
        path.mkdir()
    assert held(made, name) == [False]
    assert sum(held(made)) == 3


def test_a_sealed_file_may_be_another_and_a_plain_one_not(made):
    """A page proves itself; a table, even with a seal, is not the one that was listed."""
    for name in ("page.html", "a.csv"):
        (made / name).write_text("other\n")
    seal(made / "page.html", LIST.kind)
    assert held(made) == [False, True, True, True]


@pytest.mark.parametrize("target", ["deep/b.csv", "/etc/hostname", None])
def test_a_link_is_held_by_its_target(made, target):
    (made / "latest").unlink()
    (made / "latest").symlink_to(target) if target else (made / "latest").write_text("1\n")
    assert held(made, "latest") == [False]


def test_a_pipe_is_never_read(made):
    """One that gives the very bytes that were listed."""
    (made / "a.csv").unlink()
    os.mkfifo(made / "a.csv")
    writer = threading.Thread(target=(made / "a.csv").write_text, args=("1\n",))
    writer.start()
    try:
        assert held(made, "a.csv") == [False]
    finally:
        reader = os.open(made / "a.csv", os.O_RDONLY | os.O_NONBLOCK)
        writer.join()
        os.close(reader)


def test_a_list_without_its_seal_holds_nothing(made):
    marker = made / MARKER
    for text in (marker.read_text().replace("a.csv", "c.csv"), json.dumps({"files": {}}), "", "[]"):
        marker.write_text(text)
        assert held(made) == [False] * 4
    marker.unlink()
    assert held(made) == [False] * 4


def test_a_folder_that_is_listed_again_has_one_seal_and_the_list_of_now(made):
    (made / "c.csv").write_text("3\n")
    mark(made, LIST)
    assert (made / MARKER).read_text().count("made_by") == 1
    assert held(made, "a.csv", "c.csv") == [True, True]


@pytest.mark.parametrize("key", ["files", "sha256", "before"])
def test_every_table_of_a_list_counts_and_a_name_may_have_the_digests_of_several(made, key):
    """While a new list takes the place of an old one, a name holds what it did and what it will."""
    digest = json.loads((made / MARKER).read_text())["files"]["a.csv"]
    both = {"files": {"a.csv": "0" * 64}, "sha256": {"a.csv": "1" * 64}, "before": {"a.csv": "2" * 64}}
    both[key] = {"a.csv": digest}
    (made / MARKER).write_text(json.dumps(both, indent=1) + "\n")
    seal(made / MARKER, LIST.kind)
    assert held(made, "a.csv") == [True]


def test_a_seal_that_names_a_file_beside_holds_with_that_file_alone(tmp_path):
    table, page = tmp_path / "table.csv", tmp_path / "table.html"
    table.write_text("1\n")
    page.write_text("<html></html>\n")
    seal(page, LIST.kind, beside=table)
    assert is_sealed_with(page, table)
    same = tmp_path / "same.csv"
    same.symlink_to(table)
    assert not is_sealed_with(page, same)
    assert not is_sealed_with(page, tmp_path / "none.csv")
    table.write_text("2\n")
    assert is_sealed(page) and not is_sealed_with(page, table)
    (tmp_path / "other.html").write_text("<html></html>\n")
    seal(tmp_path / "other.html", LIST.kind)
    assert not is_sealed_with(tmp_path / "other.html", table), "a seal of the page alone"
