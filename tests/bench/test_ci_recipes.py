"""The CI recipes, executed in a foreign repository with the installed command: verdict, comment, pictures, exit code.

That the package installs from its wheel is a step of `.ci/run`.
"""

import importlib
import os
import re
import shutil
import subprocess
import sys
import threading
import urllib.parse
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

pytestmark = [pytest.mark.ci, pytest.mark.slow]
ROOT = Path(__file__).parents[2]
RECIPES = ROOT / "ci-recipes"
SUITE = """
title = "foreign"
seeds = [0, 1, 2, 3, 4]
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 1.2 }
camera = { width = 64, height = 48, horizontal_fov_deg = 65.0 }
[trackers]
still = { kind = "hold" }
"""
GH = """#!/bin/sh
printf '%s\\n' "$*" >> "$GH_CALLS"
case "$*" in *--paginate*) [ -z "${EARLIER:-}" ] || echo "$EARLIER" ;; esac
for word; do case $word in body=@*) cat "${word#body=@}" > "$GH_CALLS.body" ;; esac; done
"""


def load(name):
    return importlib.import_module("yaml").safe_load((RECIPES / name).read_text())


def cached(recipe):
    """Paths that a recipe keeps from one run to the next."""
    gate = load(recipe)["jobs" if recipe.startswith("github") else "gate"]
    if recipe == "gitlab.yml":
        return gate["cache"]["paths"]
    (step,) = [step for step in gate["gate"]["steps"] if step.get("uses", "").startswith("actions/cache@")]
    return step["with"]["path"].split()


def steps(recipe, job):
    return {step["name"]: step["run"] for step in load(recipe)["jobs"][job]["steps"] if "run" in step}


@dataclass
class Foreign:
    """A repository of somebody else, with a branch `main` that it knows as origin/main."""

    folder: Path

    def git(self, *arguments):
        identity = ["-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", *identity, *arguments], cwd=self.folder, check=True, capture_output=True)

    def served(self, *arguments):
        """What git answers on the server, as bytes."""
        server = self.folder.parent / "server.git"
        return subprocess.run(["git", *arguments], cwd=server, check=True, capture_output=True).stdout

    def shell(self, script, **variables):
        """Run a step as GitHub does, with `bash -e`."""
        summary, installed = self.folder / "summary.md", Path(sys.executable).parent
        env = {
            **{k: v for k, v in os.environ.items() if k != "GITHUB_STEP_SUMMARY"},
            "PATH": os.pathsep.join([str(self.folder.parent / "tools"), str(installed), os.environ["PATH"]]),
            "PYTHONPATH": str(ROOT),
            "GITHUB_STEP_SUMMARY": str(summary),
            "GH_CALLS": str(self.folder / "calls"),
            "SUITE": "suite.toml",
            **variables,
        }
        return subprocess.run(
            ["bash", "-e", "-c", script], cwd=self.folder, env=env, capture_output=True, text=True, check=False
        )


@pytest.fixture
def foreign(tmp_path):
    repository = Foreign(tmp_path / "theirs")
    repository.folder.mkdir()
    (repository.folder / "suite.toml").write_text(SUITE)
    repository.git("init", "-q", "-b", "main")
    repository.git("add", "-A")
    repository.git("commit", "-qm", "theirs")
    repository.git("init", "-q", "--bare", str(tmp_path / "server.git"))
    repository.git("remote", "add", "origin", str(tmp_path / "server.git"))
    repository.git("update-ref", "refs/remotes/origin/main", "HEAD")
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "gh").write_text(GH)
    (tmp_path / "tools" / "gh").chmod(0o755)
    return repository


@pytest.mark.parametrize("recipe", sorted(path.name for path in RECIPES.iterdir()))
def test_recipes_need_nothing_of_this_repository(recipe):
    text = (RECIPES / recipe).read_text()
    assert "./run" not in text and "bench/suites" not in text and "://" not in text
    assert load(recipe)


def test_github_comments_the_verdict_and_keeps_its_code(foreign):
    step = steps("github.yml", "gate")
    # Coverage and errors are the same on both sides; latency may differ on a loaded machine.
    done = foreign.shell(
        step["Gate"].replace("--suite", "--latency-margin 900% --repeats 1 --suite"), BASE="origin/main"
    )
    assert done.returncode == 0, done.stdout + done.stderr
    comment = (foreign.folder / "out/comment.md").read_text()
    assert comment.startswith("<!-- uavbench gate -->\n## uavbench gate: ")
    assert "| still@15hz | coverage |" in comment
    summary = (foreign.folder / "summary.md").read_text()
    assert summary == "".join(line for line in comment.splitlines(keepends=True) if not line.startswith("!["))
    assert ("inconclusive" in comment.splitlines()[1]) == ("::warning::" in done.stdout)

    step, variables = steps("github.yml", "comment"), {"GITHUB_REPOSITORY": "o/r", "PULL_REQUEST": "7"}
    shown = foreign.shell(step["Pictures"], GITHUB_SERVER_URL="https://github.com", **variables)
    assert shown.returncode == 0, shown.stderr
    comment = (foreign.folder / "out/comment.md").read_text()
    addresses = re.findall(r"^\[!\[.+\]\((https://github.com/o/r/blob/.+)\?raw=true\)\]\(\1\)$", comment, re.MULTILINE)
    assert len(addresses) == 3 and "](worst/" not in comment
    for address in addresses:
        commit, _, name = address.removeprefix("https://github.com/o/r/blob/").partition("/")
        on_branch = foreign.served("show", f"uavbench-pictures/7:{name}")
        assert on_branch == foreign.served("show", f"{commit}:{name}")
        assert on_branch == (foreign.folder / "out/compare/gate/worst" / name).read_bytes()
    for earlier, method in (("", "POST repos/o/r/issues/7/comments"), ("42", "PATCH repos/o/r/issues/comments/42")):
        posted = foreign.shell(step["Comment"], EARLIER=earlier, **variables)
        assert posted.returncode == 0, posted.stderr
        assert f"--method {method}" in (foreign.folder / "calls").read_text().splitlines()[-1]
        assert (foreign.folder / "calls.body").read_text() == comment


@pytest.mark.parametrize("recipe", ["github.yml", "gitlab.yml"])
def test_frames_that_a_recipe_keeps_are_not_rendered_again(foreign, recipe):
    """With what the cache brings, and nothing else of the earlier run."""
    render = "uavbench render suite.toml --jobs 1 --out out/compare/head"  # as `compare` does first
    first = foreign.shell(render)
    assert first.returncode == 0, first.stderr
    (foreign.folder / "out").rename(foreign.folder / "before")
    for path in map(Path, cached(recipe)):
        kept, place = foreign.folder / "before" / path.relative_to("out"), foreign.folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if kept.is_dir() else shutil.copy)(kept, place)
    again = foreign.shell(render)
    assert again.returncode == 0, again.stderr
    assert "0 jobs done, 5 were fresh" in again.stderr


@pytest.mark.parametrize("pictures", [False, True])
def test_a_comment_without_a_place_for_pictures_has_none(foreign, pictures):
    """Before a verdict there is none; without the right to push, none is shown."""
    worst = foreign.folder / "out/compare/gate/worst"
    worst.mkdir(parents=True)
    if pictures:
        (worst / "1.png").write_bytes(b"a picture")
        foreign.git("remote", "set-url", "origin", str(foreign.folder / "gone.git"))
    (foreign.folder / "out/comment.md").write_text("a table\n![1.png: before and after](worst/1.png)\n")
    step = steps("github.yml", "comment")["Pictures"]
    done = foreign.shell(step, GITHUB_SERVER_URL="https://github.com", GITHUB_REPOSITORY="o/r", PULL_REQUEST="7")
    assert done.returncode == 0, done.stderr
    assert (foreign.folder / "out/comment.md").read_text() == "a table\n"


def test_what_may_write_runs_no_code_of_the_pull_request():
    recipe = load("github.yml")
    assert recipe["permissions"] == {"contents": "read"} and "permissions" not in recipe["jobs"]["gate"]
    scripts = "\n".join(steps("github.yml", "comment").values())
    assert not re.search(r"^\s*(uavbench|python|pip)\b", scripts, re.MULTILINE)


@pytest.mark.parametrize(("base", "suite"), [("origin/gone", "suite.toml"), ("origin/main", "none.toml")])
def test_an_early_death_of_compare_is_told_with_its_code(foreign, base, suite):
    stale = foreign.folder / "out/compare/gate/gate.md"
    stale.parent.mkdir(parents=True)
    stale.write_text("## uavbench gate: pass\n")
    done = foreign.shell(steps("github.yml", "gate")["Gate"], BASE=base, SUITE=suite)
    assert done.returncode == 2, done.stdout + done.stderr
    comment = (foreign.folder / "out/comment.md").read_text()
    assert "no verdict" in comment and "exit code 2" in comment and "uavbench: " in comment
    assert "pass" not in comment


@pytest.mark.parametrize("status", [201, 403])
def test_gitlab_writes_a_note_and_keeps_the_code(foreign, status):
    got = []

    class Notes(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"])).decode()
            got.append((self.path, self.headers["PRIVATE-TOKEN"], urllib.parse.parse_qs(body)["body"][0]))
            self.send_response(status)
            self.end_headers()

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Notes)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    script = load("gitlab.yml")["gate"]["script"][-1]
    environment = {
        "CI_API_V4_URL": f"http://127.0.0.1:{server.server_port}/api/v4", "CI_PROJECT_ID": "5", "SUITE": "none.toml",
        "CI_MERGE_REQUEST_IID": "9", "GATE_TOKEN": "secret", "no_proxy": "127.0.0.1",
    }  # fmt: skip
    done = foreign.shell(script, **environment)
    without = foreign.shell(script, **{**environment, "GATE_TOKEN": ""})
    server.shutdown()
    server.server_close()
    assert done.returncode == without.returncode == 2, done.stdout + done.stderr
    ((path, token, body),) = got
    assert (path, token) == ("/api/v4/projects/5/merge_requests/9/notes", "secret")
    assert "no verdict" in body and "exit code 2" in body
    assert ("no note" in done.stdout) == (status == 403)
    assert "GATE_TOKEN is not set" in without.stdout


def test_nightly_keeps_the_code_of_the_run(foreign):
    done = foreign.shell(steps("github-nightly.yml", "nightly")["Run"], SUITE="none.toml")
    assert done.returncode == 2
    assert "none.toml" in done.stdout


def test_the_history_is_kept_on_its_branch_and_grows_with_each_commit(foreign):
    step = steps("github-history.yml", "history")
    for number, again in ((1, False), (2, False), (2, True)):
        if not again:  # a person may run the job of a commit again
            foreign.git("commit", "-q", "--allow-empty", "-m", f"change {number}")
        measured = foreign.shell(step["Measure"])
        assert measured.returncode == 0, measured.stderr
        done = foreign.shell(step["History"])
        assert done.returncode == 0, done.stdout + done.stderr
        assert f"{number} of the 4 commits" in done.stdout
        foreign.git("worktree", "remove", "--force", "out/kept")
        foreign.git("branch", "-D", "uavbench-history") if number == 1 else None
    kept = foreign.served("show", "uavbench-history:history.json").decode()
    assert kept.count('"subject": "change') == 2 and '"name": "github-hosted"' in kept
    names = foreign.served("ls-tree", "-r", "--name-only", "uavbench-history").decode()
    assert "page/index.html" in names and "suite.toml" not in names
