"""The paper has the form of JOSS, its citations and numbers hold; container file and conda recipe name what is."""

import re
import tomllib

import yaml

import uavbench
from tests.docs.pages import ROOT

PAPER = (ROOT / "paper.md").read_text(encoding="utf-8")
LEAST_WORDS, MOST_WORDS = 250, 1750
"""Of a paper, as JOSS has it; the lower bound is that of its older guide."""


def test_the_paper_has_the_form_of_joss():
    _, head, body = PAPER.split("---\n", 2)
    about = yaml.safe_load(head)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(about)
    known = {each["index"] for each in about["affiliations"]}
    assert all(author["affiliation"] in known for author in about["authors"])
    assert (ROOT / about["bibliography"]).is_file()
    heads = re.findall(r"^# (.+)$", body, re.MULTILINE)
    assert heads[0] == "Summary" and heads[1] == "Statement of need" and heads[-1] == "References"
    assert LEAST_WORDS <= len(body.split()) <= MOST_WORDS


def test_every_citation_is_in_the_bibliography_and_every_entry_is_cited():
    cited = set(re.findall(r"@(\w+)", PAPER.split("---\n", 2)[2]))
    listed = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited == set(listed) and len(listed) == len(set(listed))


def test_the_paper_s_numbers_are_those_of_the_readme():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for number in re.findall(r"[0-9.]+ (?:cm|%)", PAPER):
        assert number in readme, number


def test_the_container_installs_what_run_needs_and_copies_no_results():
    container = (ROOT / "Containerfile").read_text(encoding="utf-8")
    script = (ROOT / "run").read_text(encoding="utf-8")
    for package in re.search(r"set -- (libegl1 .*)", script)[1].split():
        assert package in container
    assert 'ENTRYPOINT ["./run"]' in container and 'CMD ["demo"]' in container
    ignored = (ROOT / ".containerignore").read_text(encoding="utf-8").splitlines()
    assert {".venv", "out", ".git"} <= set(ignored)


ON_CONDA = {"opencv-python-headless": "py-opencv", "mujoco": "mujoco-python", "matplotlib": "matplotlib-base"}


def test_the_conda_recipe_asks_for_what_the_package_asks_for_and_runs_the_demo():
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, overrides = about["project"], about["tool"]["uv"]["override-dependencies"]
    asked = dict(re.split(r"(?=[<>=])", text, maxsplit=1) for text in project["dependencies"])
    wanted = {f"{ON_CONDA.get(name, name)} {bound}" for name, bound in asked.items()}
    wanted |= {text.lower().replace("==", " >=") for text in overrides}
    run = set(recipe["requirements"]["run"])
    (python,) = run - wanted
    assert wanted < run
    script = (ROOT / "run").read_text(encoding="utf-8")
    least, below = re.search(r"not \((\d, \d+)\) <= sys.version_info < \((\d, \d+)\)", script).groups()
    assert python == f"python >={least},<{below}".replace(", ", ".")
    assert project["requires-python"] == f">={least}".replace(", ", ".")
    assert recipe["package"] == {"name": project["name"], "version": uavbench.__version__}
    (entry,) = recipe["build"]["python"]["entry_points"]
    assert entry == f"uavbench = {project['scripts']['uavbench']}"
    (demo,) = re.findall(r'exec "\$venv/bin/uavbench" (run \S+ --out) "\$root/(\S+)"', script)
    assert f"uavbench {demo[0]} {demo[1]}" in recipe["tests"][0]["script"]
    assert recipe["about"]["license"] == project["license"]
    assert (ROOT / "conda" / recipe["source"]["path"] / recipe["about"]["license_file"]).is_file()
