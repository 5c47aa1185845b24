"""The examples for Slurm and Kubernetes as text: they parse, and name commands and options that there are."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import typer

from tactilevision.cli.app import app

EXAMPLES = Path(__file__).parents[2] / "examples" / "cluster"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))
IMAGE = re.compile(r"registry\.example\.org/tactilevision:([\d.]+)")


def dask_options(what: str) -> set[str]:
    cli = pytest.importorskip(f"distributed.cli.dask_{what}")
    return {name for option in cli.main.params for name in (*option.opts, *option.secondary_opts)}


def check(words: list[str]) -> None:
    """The command line `words` is one of tactilevision's or Dask's, with options that it has."""
    options = {word for word in words if word.startswith("--")}
    assert options
    if words[0] == "dask":
        assert options <= dask_options(words[1])
    else:
        command = typer.main.get_command(app).get_command(None, words[1])  # type: ignore[attr-defined]
        assert options <= {name for option in command.params for name in option.opts}


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.name)
def test_a_program_parses_and_hands_the_scheduler_to_a_command(path: Path) -> None:
    tree = ast.parse(path.read_text())
    lists = [
        [word.value for word in node.elts if isinstance(word, ast.Constant) and isinstance(word.value, str)]
        for node in ast.walk(tree)
        if isinstance(node, ast.List)
    ]
    (command,) = [words for words in lists if words[:1] == ["tactilevision"]]
    check(command)
    assert ["--cluster"] in lists
    assert "cluster.scheduler_address" in path.read_text()


def test_the_script_is_a_shell_script_with_known_commands() -> None:
    script = EXAMPLES / "slurm_job.sh"
    subprocess.run([shutil.which("bash") or "bash", "-n", str(script)], check=True)
    lines = [line.removeprefix("srun ").split() for line in script.read_text().splitlines()]
    commands = [words for words in lines if words[:1] in (["dask"], ["tactilevision"])]
    assert [words[:2] for words in commands] == [
        ["dask", "scheduler"],
        ["dask", "worker"],
        ["tactilevision", "depth"],
    ]
    for words in commands:
        check(words)


def test_the_manifest_names_known_commands_and_one_disk() -> None:
    yaml = pytest.importorskip("yaml")
    parts: list[dict[str, Any]] = list(yaml.safe_load_all((EXAMPLES / "kubernetes.yaml").read_text()))
    assert [part["kind"] for part in parts] == ["Service", "Deployment", "Deployment", "Job"]
    pods = [part["spec"]["template"]["spec"] for part in parts[1:]]
    for pod in pods:
        check(pod["containers"][0]["args"])
    scheduler, *seeing = pods
    assert scheduler["containers"][0]["args"][3] == str(parts[0]["spec"]["ports"][0]["port"])
    assert seeing[0]["volumes"] == seeing[1]["volumes"]
    assert seeing[0]["containers"][0]["volumeMounts"] == seeing[1]["containers"][0]["volumeMounts"]
    for part in parts[1:3]:
        assert part["spec"]["selector"]["matchLabels"] == part["spec"]["template"]["metadata"]["labels"]


def test_images_are_of_this_version() -> None:
    versions = {
        found for path in EXAMPLES.iterdir() if path.is_file() for found in IMAGE.findall(path.read_text())
    }
    assert versions == {version("tactilevision")}
