"""The paper has the form of JOSS, its citations and numbers hold; the container file names what is there."""

import re

import yaml

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
