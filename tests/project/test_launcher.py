"""docker/run, with stubs in place of the container engine, of bubblewrap and of mmdebstrap."""

import os
import shutil
import signal
import subprocess
import textwrap
import time
from itertools import pairwise
from pathlib import Path

import pytest

TREE = Path(__file__).resolve().parents[2]
# Each stub adds its arguments, one a line, and an empty line to a log beside it.
STUBS = {
    "docker": """
        case "$1 $2" in
          info*) echo " $STUB_INFO" ;;
          "image inspect") exit 1 ;;
          run*) exit 5 ;;
        esac
    """,
    "setpriv": """
        until [ "$1" = rm ] || [ "$1" = mmdebstrap ]; do shift; done
        exec "$@"
    """,
    "mmdebstrap": """
        mkdir -p "${!#}/etc" && touch "${!#}/etc/passwd"
        [ ! -e "$STUB_BUILD_FAILS" ]
    """,
    "bwrap": """
        case " $* " in *" -- "*) ;; *" ${STUB_REFUSES:-none} "*) exit 1 ;; esac
        until [ "$1" = -- ]; do [ $# -gt 0 ] || exit 0; shift; done
        shift
        "$@" <&0 &
        wait $!
    """,
    "newuidmap": "",
}


def write_program(path, text):
    path.write_text(text)
    path.chmod(0o755)


@pytest.fixture
def stubs(tmp_path):
    folder = tmp_path / "stubs"
    folder.mkdir()
    for name, text in STUBS.items():
        text = '#!/bin/bash\nprintf "%s\\n" "$@" "" >>"$0.log"\n' + textwrap.dedent(text)
        write_program(folder / name, text)
    return folder


@pytest.fixture
def launch(stubs, tmp_path):
    """Call docker/run with the stubs and without the variables of the outer launcher."""
    taken = ("DEBIAN", "DOLFINX_CONTACT_", "OMPI_", "PRTE_", "PMIX_", "PYTHONPATH")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(taken)}
    clean["PATH"] = f"{stubs}:{clean['PATH']}"
    clean["DOLFINX_CONTACT_CACHE"] = str(tmp_path / "the cache")

    def call(*command, way=None, tree=TREE, start=subprocess.run, **variables):
        env = clean | variables | ({"DOLFINX_CONTACT_ENV": way} if way else {})
        streams = {"input": "given"} if start is subprocess.run else {"stdout": subprocess.PIPE}
        if start is subprocess.run:
            streams |= {"capture_output": True, "timeout": 60}
        return start([tree / "docker/run", *command], env=env, cwd=tmp_path, text=True, **streams)

    return call


def calls(stub):
    """The argument lists of calls to a stub, one list for each call."""
    log = stub.with_name(stub.name + ".log")
    return [c.split("\n") for c in log.read_text().split("\n\n")[:-1]] if log.exists() else []


def test_refuses_what_it_does_not_know(launch):
    for result, message in [
        (launch(), "usage"),
        (launch("--help"), "usage"),
        (launch("true", DEBIAN="woody"), "woody"),
        (launch("true", way="nowhere"), "nowhere"),
    ]:
        assert result.returncode == 125
        assert message in result.stderr


def test_a_usable_dolfinx_is_used_directly(launch, stubs):
    result = launch("bash", "-c", "echo $PPID $PYTHONPATH; exit 3")
    assert (result.returncode, result.stderr) == (3, "")
    assert result.stdout == f"{os.getpid()} {TREE}\n"  # exec: no process in between
    assert not list(stubs.glob("*.log"))


def test_mpirun_needs_no_more_variables(launch):
    code = "from mpi4py import MPI; print(MPI.COMM_WORLD.size)"
    result = launch("mpirun", "-n", "3", "python3", "-c", code, way="direct")
    assert result.stdout.count("3") == 3, result.stderr


@pytest.mark.parametrize("way", ["direct", "root"])
def test_streams_arguments_and_exit_codes_pass(launch, way):
    result = launch("bash", "-c", 'cat; printf "<%s>" "$@"; exit 3', "_", "a b", "", "*", way=way)
    assert (result.returncode, result.stdout) == (3, "given<a b><><*>")
    assert launch("no-such-command", way=way).returncode == 127
    assert launch("bash", "-c", "kill -KILL $$", way=way).returncode in (137, -signal.SIGKILL)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_reach_the_command_in_the_root(launch, number):
    launch("true", way="root")
    # Between two commands in the foreground bash may lose a SIGINT; while it waits it does not.
    script = f"sleep 60 & trap 'kill $!; exit 7' {number.value}; echo ready; wait"
    process = launch("bash", "-c", script, way="root", start=subprocess.Popen)
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.2)  # bash may not see a signal that comes as it begins to wait
    process.send_signal(number)
    assert process.wait(timeout=20) == 7


def test_without_dolfinx_an_engine_is_used(launch, stubs):
    write_program(stubs / "python3", "#!/bin/sh\nexit 1\n")
    assert launch("true").returncode == 5  # of the stub's run
    assert launch("true", DOLFINX_CONTACT_ENV="direct").returncode == 0


def test_launcher_passes_arguments_to_the_container(launch, stubs, tmp_path):
    result = launch("echo", "a b", DEBIAN="sid")
    assert result.returncode == 5
    *_, build, _, run = calls(stubs / "docker")
    assert build[:3] == ["build", "--build-arg", "DEBIAN=sid"]
    assert build[-3:] == ["-f", str(TREE / "docker/Dockerfile"), str(TREE / "docker")]
    image = build[build.index("-t") + 1]
    assert run[-3:] == [image, "echo", "a b"]
    assert "--tty" not in run
    pairs = set(pairwise(run))
    assert {
        ("--volume", f"{TREE}:{TREE}"),
        ("--volume", f"{tmp_path}:{tmp_path}"),
        ("--workdir", str(tmp_path)),
        ("--user", f"{os.getuid()}:{os.getgid()}"),
        ("--env", "OMPI_ALLOW_RUN_AS_ROOT"),
        ("--env", "PYTHONPATH"),
        ("--env", "XDG_CACHE_HOME"),
    } <= pairs
    launch("true", way="container", STUB_INFO="rootless: true")
    assert "--user" not in calls(stubs / "docker")[-1]


def test_root_is_built_once_and_entered(launch, stubs, tmp_path):
    first = launch("pwd", way="root")
    second = launch("pwd", way="root")
    assert first.stdout == second.stdout == f"{tmp_path}\n"
    assert "building" in first.stderr
    assert second.stderr == ""
    (build,) = calls(stubs / "mmdebstrap")
    (include,) = (a.removeprefix("--include=") for a in build if a.startswith("--include="))
    packages = (TREE / "docker/packages.txt").read_text().splitlines()
    assert include.split(",") == [p for p in packages if not p.startswith("#")]
    assert "python3-dolfinx-real" in packages
    assert build[-2] == "trixie"
    *_, enter = calls(stubs / "bwrap")
    assert enter[enter.index("--chdir") + 1] == str(tmp_path)
    binds = [enter[i + 1] for i, a in enumerate(enter) if a == "--bind"]
    assert any(TREE.is_relative_to(b) for b in binds)


def test_the_wheel_serves_demos_before_a_root_is_built(launch, stubs, tmp_path):
    """Where that is asked for, and Python allows it; a root that is there is taken."""
    for name in ("python3", "docker", "podman"):
        write_program(stubs / name, "#!/bin/sh\nexit 1\n")
    tree = tmp_path / "tree"
    shutil.copytree(TREE / "docker", tree / "docker")
    wheel = """
        #!/bin/sh
        echo "$DOLFINX_CONTACT_CACHE" "$@"
        [ "$1" != --serves ] || exit "${STUB_SERVES:-0}"
        [ "$2" != python3 ] || exit "${STUB_PIP:-0}"
        exit 6
    """
    write_program(tree / "docker/wheel", textwrap.dedent(wheel).lstrip())
    asked = {"tree": tree, "DOLFINX_CONTACT_WHEEL": "yes"}
    result = launch("echo", "a b", **asked)
    assert result.returncode == 6
    assert result.stdout.splitlines()[-1] == f"{tmp_path}/the cache solver,pictures,gmsh echo a b"
    assert not calls(stubs / "mmdebstrap")
    for number, failing in enumerate(["STUB_SERVES", "STUB_PIP", "asked", "there"], start=1):
        how = {"DOLFINX_CONTACT_WHEEL": ""} if failing == "asked" else {failing: "1"}
        if failing != "there":
            shutil.rmtree(tmp_path / "the cache")
        result = launch("echo", "ours", **asked | how)
        assert result.returncode == 0
        assert result.stdout.splitlines()[-1] == "ours"
        assert len(calls(stubs / "mmdebstrap")) == min(number, 3)


def test_a_failed_build_is_started_afresh(launch, tmp_path):
    switch = tmp_path / "fails"
    switch.touch()
    result = launch("true", way="root", STUB_BUILD_FAILS=str(switch))
    assert result.returncode == 125
    assert "run it again" in result.stderr
    (part,) = (tmp_path / "the cache").glob("debian-trixie-*.part")
    (part / "remains").touch()
    switch.unlink()
    assert launch("true", way="root", STUB_BUILD_FAILS=str(switch)).returncode == 0
    (root,) = (tmp_path / "the cache").glob("debian-trixie-*")
    assert not (root / "remains").exists()
