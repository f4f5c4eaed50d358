"""What the papers of the house promise: commands that exist, pages that are reachable, one version, no strays."""

import importlib
import re
from importlib.resources import files
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import cgi_wave
from cgi_wave.cli.commands import COMMANDS

HOUSE = Path(__file__).parents[1]
README = (HOUSE / "README.md").read_text(encoding="utf-8")
PAGES = sorted([*HOUSE.glob("*.md"), *HOUSE.glob("docs/**/*.md")])
SET_UP = "pip install uv && uv run "


def test_first_screen_has_two_commands_that_set_themselves_up():
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    assert blocks == [f"{SET_UP}cgi-wave run --out out\n", f"{SET_UP}pytest\n"]
    assert README[: README.rindex(blocks[-1])].count("\n") < 20


def test_ci_runs_the_command_of_the_readme():
    assert f"{SET_UP}pytest" in (HOUSE / ".ci" / "run").read_text().splitlines()


def test_readme_names_every_command_and_no_other():
    assert set(re.findall(r"`cgi-wave ([a-z]+)", README)) == {command.name for command in COMMANDS}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        assert "://" in target or (page.parent / target).exists(), target


def test_index_lists_every_page_of_the_docs():
    index = (HOUSE / "docs" / "index.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\(([\w/-]+\.md)\)", index))
    assert listed == {str(page.relative_to(HOUSE / "docs")) for page in HOUSE.glob("docs/**/*.md")} - {"index.md"}


def test_changelog_starts_with_this_version():
    assert re.search(r"^## (\S+)", (HOUSE / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == cgi_wave.__version__


def test_contributing_lists_every_floor():
    table = re.findall(r"^\| (`.*?) \|", (HOUSE / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    named = {name for row in table for name in re.findall(r"`(\w+)`", row)}
    package = Path(cgi_wave.__file__).parent
    assert {path.parent.name for path in package.glob("*/__init__.py")} <= named


def test_template_and_instrument_are_in_the_package():
    assert files("cgi_wave.report").joinpath("templates/index.html").is_file()
    assert files("cgi_wave").joinpath("data/reference.toml").is_file()
    assert files("cgi_wave").joinpath("py.typed").is_file()


@pytest.mark.parametrize("module", sorted((HOUSE / "cgi_wave").rglob("*.py")), ids=lambda path: path.stem)
def test_modules_stay_small(module):
    # A compiled call tree has to stay in one file, so kernels may be longer.
    limit = 600 if module.parent.name == "kernels" else 500
    assert len(module.read_text(encoding="utf-8").splitlines()) <= limit


def test_compiled_functions_have_names_of_their_own():
    """Numba's cached code is linked by names: two functions of one name call each other's code (``kernels.trace``)."""
    names = []
    for file in sorted((HOUSE / "cgi_wave" / "kernels").glob("[a-z]*.py")):
        module = importlib.import_module(f"cgi_wave.kernels.{file.stem}")
        for value in vars(module).values():
            if isinstance(value, Dispatcher) and value.py_func.__module__ == module.__name__:
                names.append((module.__name__, value.py_func.__qualname__))
    assert len(names) > 50
    assert len(names) == len(set(names))
    assert not [name for name in names if "<locals>" in name[1]]
