import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from gpszip.cli.main import _COMMANDS, ExitCode, cli, main
from gpszip.cli.topics import TOPICS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", _COMMANDS)
def test_help_of_a_command_is_that_of_its_option(gpszip, name):
    assert gpszip("help", name).out == gpszip(name, "--help").out


@pytest.mark.parametrize("topic", TOPICS)
def test_topics_fit_a_terminal_of_80_columns(gpszip, topic):
    run = gpszip("help", topic)
    assert run.code == 0
    assert run.out.rstrip() == TOPICS[topic].rstrip()
    assert max(map(len, run.out.splitlines())) <= 80


@pytest.mark.parametrize("name", _COMMANDS)
def test_help_names_every_option_once(gpszip, name):
    command = cli.get_command(click.Context(cli), name)
    options = [p for p in command.get_params(click.Context(command)) if isinstance(p, click.Option)]
    told = gpszip(name, "--help").out
    _, *sections = re.split(r"^[A-Z][\w ']+:$", told, flags=re.MULTILINE)
    shown = re.findall(r"^  (?:-\w, )?(--[\w-]+)", "".join(sections), re.MULTILINE)
    # A name of an option is its first long one.
    assert sorted(shown) == sorted(
        next(name for name in option.opts if "--" in name) for option in options
    )
    assert ("\nOutput:\n" in told) == (len(options) >= 15)


def test_help_alone_lists_commands_and_topics(gpszip):
    told = gpszip("help").out
    assert all(re.search(rf"^  {name}\b", told, re.MULTILINE) for name in _COMMANDS)
    assert told.rstrip().endswith(", ".join(TOPICS) + ".")


def test_an_unknown_topic_names_the_nearest(gpszip):
    run = gpszip("help unit")
    assert run.code == 2
    assert "did you mean units?" in run.err
    run = gpszip("help qqq")
    assert "there are errors, units" in run.err


def test_the_topic_of_exit_codes_has_all_of_them():
    listed = re.findall(r"^ *(\d+)  ", TOPICS["exit-codes"], re.MULTILINE)
    assert sorted(map(int, listed)) == sorted(map(int, ExitCode))


def test_the_topic_of_the_environment_has_every_variable(gpszip):
    told = "".join(gpszip(name, "--help").out for name in _COMMANDS)
    variables = set(re.findall(r"GPSZIP_[A-Z]+", told))
    assert variables
    assert variables == set(re.findall(r"GPSZIP_[A-Z]+", TOPICS["environment"]))


def test_variables_set_options_and_options_win(gpszip, log, monkeypatch):
    monkeypatch.setenv("GPSZIP_EFFORT", "12")
    run = gpszip("compress walk.csv --rmse 1m")
    assert run.code == 2
    assert "12" in run.err
    assert gpszip("compress walk.csv --rmse 1m --effort 1").code == 0


# Completion.


def complete(shell, words, monkeypatch, capfd):
    """Answers of the program to a shell that completes the last word."""
    monkeypatch.setenv("_GPSZIP_COMPLETE", f"{shell}_complete")
    monkeypatch.setenv("COMP_WORDS", " ".join(words))
    monkeypatch.setenv("COMP_CWORD", words[-1] if shell == "fish" else str(len(words) - 1))
    capfd.readouterr()
    main([])
    return capfd.readouterr().out.split()


def test_commands_options_and_choices_are_completed(monkeypatch, capfd):
    assert complete("bash", ["gpszip", "dec"], monkeypatch, capfd) == ["plain,decompress"]
    words = ["gpszip", "compress", "--max"]
    assert complete("bash", words, monkeypatch, capfd) == ["plain,--max-error"]
    words = ["gpszip", "compress", "--engine", "t"]
    assert complete("bash", words, monkeypatch, capfd) == ["plain,threads"]


def test_archives_are_completed_with_their_folders(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    for name in ("walk.gpsz", "walk.csv", "other.gpsz", ".walk.gpsz"):
        Path(name).touch()
    Path("walks").mkdir()
    Path("walks", "one.gpsz").touch()
    found = complete("bash", ["gpszip", "info", "w"], monkeypatch, capfd)
    assert found == ["plain,walk.gpsz", "plain,walks/"]
    found = complete("bash", ["gpszip", "info", "walks/"], monkeypatch, capfd)
    assert found == ["plain,walks/one.gpsz"]
    found = complete("bash", ["gpszip", "info", "."], monkeypatch, capfd)
    assert found == ["plain,.walk.gpsz"]
    assert complete("bash", ["gpszip", "info", "nowhere/"], monkeypatch, capfd) == []


def test_logs_are_completed_by_the_shell_itself(monkeypatch, capfd):
    assert complete("bash", ["gpszip", "compress", "a"], monkeypatch, capfd) == ["file,a"]


@pytest.mark.parametrize(
    ("shell", "word"),
    [("bash", "complete -o nosort"), ("zsh", "#compdef gpszip"), ("fish", "complete --no-files")],
)
def test_scripts_for_shells(gpszip, shell, word):
    run = gpszip("completion", shell)
    assert run.code == 0
    assert word in run.out
    assert "_GPSZIP_COMPLETE" in run.out
    assert run.err == ""


def test_bash_completes_with_the_script(gpszip, tmp_path):
    (tmp_path / "script").write_text(gpszip("completion bash").out)
    (tmp_path / "gpszip").write_text(f'#!/bin/sh\nexec {sys.executable} -m gpszip "$@"\n')
    (tmp_path / "gpszip").chmod(0o755)
    words = "source ./script; COMP_WORDS=(gpszip verif); COMP_CWORD=1; "
    done = subprocess.run(
        ["bash", "-c", words + "_gpszip_completion ./gpszip; echo ${COMPREPLY[@]}"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    assert done.stdout.strip() == "verify"


# Names of outputs.


def test_one_log_gets_an_archive_beside_it(gpszip, log, tmp_path):
    (tmp_path / "logs").mkdir()
    log.rename(tmp_path / "logs" / "walk.csv")
    assert gpszip("compress logs/walk.csv --rmse 1m --effort 1").code == 0
    assert (tmp_path / "logs" / "walk.gpsz").exists()
    run = gpszip("compress logs/walk.csv --rmse 1m --effort 1")
    assert run.code == 1
    assert "logs/walk.gpsz: exists already" in run.err


def test_an_archive_gives_its_name_to_log_and_map(gpszip, archive, tmp_path):
    assert gpszip("decompress two.gpsz").code == 0
    assert gpszip("map two.gpsz").code == 0
    assert (tmp_path / "two.csv").read_text().startswith("track_id,")
    assert (tmp_path / "two-map.geojson").exists()


@pytest.mark.parametrize(
    "arguments",
    ["compress -", "compress a.csv b.csv", "compress *.csv", "compress a.csv --append", "map -"],
)
def test_no_name_is_guessed(gpszip, arguments):
    run = gpszip(arguments)
    assert run.code == 2
    assert "no output was named; add -o" in run.err


# Man pages.


def test_every_command_has_a_man_page(tmp_path):
    script = ROOT / "scripts" / "write_man_pages.py"
    subprocess.run([sys.executable, script, tmp_path], check=True)
    pages = {page.stem for page in tmp_path.iterdir()}
    assert pages == {"gpszip", *(f"gpszip-{name}" for name in _COMMANDS)}
    page = (tmp_path / "gpszip-compress.1").read_text()
    assert "GPSZIP_EFFORT" in page
    assert "parquet, gpx" in page
