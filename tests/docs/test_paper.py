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


CONDA = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
RECIPE = yaml.safe_load(CONDA)
ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_conda_recipe_asks_for_what_the_package_asks_for():
    on_pypi = dict(re.findall(r"^    - (\S+) \S+  # (\S+)$", CONDA, re.MULTILINE))
    run, host = set(RECIPE["requirements"]["run"]), RECIPE["requirements"]["host"]
    asked = {on_pypi.get(name, name) + bound for name, bound in map(str.split, run)}
    wanted = set(ABOUT["project"]["dependencies"])
    wanted |= {text.lower().replace("==", ">=") for text in ABOUT["tool"]["uv"]["override-dependencies"]}
    (python,) = asked - wanted
    assert wanted < asked and len(asked) == len(run)
    script = (ROOT / "run").read_text(encoding="utf-8")
    least, below = re.search(r"not \((\d, \d+)\) <= sys.version_info < \((\d, \d+)\)", script).groups()
    assert python == f"python>={least},<{below}".replace(", ", ".")
    assert ABOUT["project"]["requires-python"] == f">={least}".replace(", ", ".")
    assert {text.replace(" ", "") for text in host} == {python, "pip", *ABOUT["build-system"]["requires"]}


def test_the_conda_recipe_is_of_this_package_and_runs_the_demo():
    project = ABOUT["project"]
    assert RECIPE["package"] == {"name": project["name"], "version": uavbench.__version__}
    (entry,) = RECIPE["build"]["python"]["entry_points"]
    assert {entry} == {f"{name} = {function}" for name, function in project["scripts"].items()}
    script = (ROOT / "run").read_text(encoding="utf-8")
    (demo,) = re.findall(r'exec "\$venv/bin/uavbench" (run \S+ --out) "\$root/(\S+)"', script)
    assert f"uavbench {demo[0]} {demo[1]}" in RECIPE["tests"][-1]["script"]
    assert RECIPE["about"]["summary"] == project["description"]
    assert RECIPE["about"]["license"] == project["license"]
    assert [RECIPE["about"]["license_file"]] == project["license-files"]


def test_the_conda_recipe_copies_what_the_wheel_is_made_of_and_expects_all_of_it():
    links = [path for path in (ROOT / "src" / "uavbench").iterdir() if path.is_symlink()]
    files = {"pyproject.toml", ABOUT["project"]["readme"], *ABOUT["project"]["license-files"]}
    assert (ROOT / "conda" / RECIPE["source"]["path"]).resolve() == ROOT.resolve()
    assert set(RECIPE["source"]["filter"]) == files | {"src/**"} | {f"{link.resolve().name}/**" for link in links}
    contents = RECIPE["tests"][0]["package_contents"]
    (kinds,) = ABOUT["tool"]["setuptools"]["package-data"].values()
    ours = {f"uavbench-{uavbench.__version__}.dist-info/**", "uavbench/**", *(f"uavbench/{kind}" for kind in kinds)}
    assert contents["strict"] and set(contents["site_packages"]) == ours
