"""commands.py TOP BUILD WORLD: paste every command of README.md, of the guide and of each --help.

Those of one page, or of one --help, run in order in a copy of the folder WORLD, which has the files that they name.  A
command must end with 0.  TABLE has what else may be, and what is not run, with the reason.  A row without a command is a
fault, as a command that fails is.  What a command's --out names is removed before it.  ONLY=REGEX: of these sources."""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

top, b, world = (pathlib.Path(a) for a in sys.argv[1:])
pyrovox = b / "bin/pyrovox"
LONG, PATIENCE, ONLY = bool(os.environ.get("T_LONG")), float(os.environ["patience"]), os.environ.get("ONLY", "")
SHOWN = r"(sudo |PYROVOX_\w+=\S+ )?(pyrovoxd?|make|mpirun|ssh|cat|printf|systemctl) |\(echo|build/"
# What the pattern finds in "SOURCE: COMMAND" is "not" run for a reason; runs in the "long" form alone; runs "until" it says
# that, then gets Ctrl-C; ends with a "code" up to that;
# has cameras of its "own", which no daemon holds; runs "beside" that, or after an "order" to the world's cameras; that
# comes "then".
TABLE = r"""
: make                                  | not: targets, which other tests and CI run
COMMAND --help|render --strip$|--fps 10$ | not: a part of a command
: sudo |sudo sh|systemctl               | not: needs root
ssh -L                                  | not: needs another host
--slurm                                 | not: needs Slurm (make test-cluster)
/(etc|run|data)/|//lab:|(me.key|host.key|lab.pub) | not: folders, hosts and keys of a site (080-doctor.sh, 086-keys.sh, 096-view.sh)
test [^\n]* aravis:192                  | not: addresses of a site (081-cameras.sh)
--address 127.0.0.2                     | not: needs addresses of this host (055-faults.sh has the faults)
calibrate( live|.md): pyrovox calibrate live --config pyrovoxd | not: needs a board; the last lines of its --help have one
import: pyrovox|calibrate import        | not: needs files of other programs (108-exchange.sh)
colour: pyrovox                         | not: needs coloured light (unit/test_light)
build/bin/pyrovox demo|demo: pyrovox demo --s | long
: pyrovox demo( --view)?$               | long; until: sets/s
turntable|flame.mp4|turn.apng           | long
experiment: pyrovox|experiment frames   | long
refine: pyrovox|pyrovox calibrate refine | long; code: 1
pyrovox (calibrate check|advise)|mpirun|gain --rig .* --flame|render --orbit 120 vol movie | long
--grid (128|256)|--at 10:               | long
: pyrovox doctor                        | code: 2
: pyrovoxd --?c\S* \S+ *(#[^\n]*)?$|PYROVOX_CPU=ref | own; until: running
: pyrovox simcams .*-- pyrovoxd         | until: running
: pyrovox cameras test                  | own; code: 1
cameras -l v4l2                         | code: 1
background --live                       | order: empty all on
: pyrovox top                           | until: sets/s
top .*tcp://                            | beside: pyrovox play flame.h5 --loop --endpoint tcp://127.0.0.1:5555
: pyrovox record (--out|--format)       | until: volumes,
: pyrovox (view|share)                  | until: Ctrl-C ends it|volumes,
: pyrovox replay (take|--speed)         | until: ready
: pyrovox play(?!.* record)             | until: .
--join .*# shows                        | code: 1
solve: pyrovox                          | long
run.md: pyrovox record --raw start      | then: pyrovox record --raw stop
ctl record start flame                  | then: pyrovox ctl record stop
ctl record start volumes                | then: pyrovox ctl record stop volumes
simcams .*calibrate live                | long; until: next: 
"""

FIRST = {"play": "pyrovox convert flame.h5 flame --format npy", "calibrate dark": "cp take.h5 flame.h5"}


def joined(lines):
    """Lines that go on after a backslash, as one."""
    out, goes_on = [], False
    for line in lines:
        if goes_on:
            out[-1] += "\n" + line
        else:
            out.append(line)
        goes_on = line.endswith("\\")
    return out


def of_page(path):
    text = path.read_text()
    if path.name != "first-hour.md":  # 102 pastes those blocks
        text = re.sub(r"^```sh$(.*?)^```$", lambda m: m[1].replace("\n", "\n    "), text, flags=re.M | re.S)
    blocks = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    yield from joined(re.findall(r"^ {4,}(\S.*)$", blocks, re.M))
    for c in re.findall(r"`([^`]+)`", re.sub(r"\s+", " ", blocks)):
        if re.match(r"(build/bin/)?pyrovoxd? .*--", c):
            yield c


def said(*words):
    return subprocess.run([str(w) for w in words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False).stdout


def of_help(*words):
    text = said(*words, "--help-all") or said(*words, "--help")
    return joined(line[2:] for line in text.splitlines() if line.startswith("  "))


def names(head, *words):
    return re.findall(r"^  (\S+)", said(*words, "--help").split(head + "\n")[1].split("\n\n")[0], re.M)


def commands():
    """SOURCE, COMMAND of all."""
    shown = [(p.name, of_page(p)) for p in [top / "README.md", *sorted((top / "daemon/man/guide").glob("*.md"))]]
    shown += [(c, of_help(pyrovox, c)) for c in names("Commands:", pyrovox)]
    shown += [("calibrate " + c, of_help(pyrovox, "calibrate", c)) for c in names("Steps:", pyrovox, "calibrate")]
    shown += [("pyrovoxd", of_help(b / "bin/pyrovoxd"))]
    return [(source, c) for source, lines in shown for c in lines if re.match(SHOWN, c) and re.search(ONLY, source)]


def ended(p):
    """Ctrl-C for a process and what it started; SIGKILL, and False, if it heeds that not."""
    for sign in (signal.SIGINT, signal.SIGKILL):
        try:
            os.killpg(p.pid, sign)
            p.wait(PATIENCE)
            return sign == signal.SIGINT
        except ProcessLookupError:
            p.wait()
            return True
        except subprocess.TimeoutExpired:
            pass
    return False


def paste(command, here, how):
    """What is wrong with what the command does: "" if nothing."""
    made = re.search(r"--out ([^\s;]+)", command)
    if made and "--join" not in command and command.count(f" {made[1]}") == 1:
        for name in (made[1], made[1] + ".parts", made[1].replace(".yaml", "-frames")):
            shutil.rmtree(here / name, ignore_errors=True)
        (here / made[1]).unlink(missing_ok=True)
    run = tempfile.mkdtemp(dir=here.parent) if re.search("pyrovoxd|replay|: pyrovox play|play flame", command) else os.environ["RUNTIME_DIRECTORY"]
    words = ["bash", "-eo", "pipefail", "-c", command]
    if "own" in how:
        words = [pyrovox, "simcams", "--rig", "rig.yaml", "--ring", "2", "--private-net", "--", *words]

    def start(words, out):
        return subprocess.Popen(words, cwd=here, env={**os.environ, "RUNTIME_DIRECTORY": run}, stdin=subprocess.DEVNULL,
                                stdout=out, stderr=out, start_new_session=True)

    def text():
        return pathlib.Path(out.name).read_text(errors="replace")

    if "order" in how:
        pathlib.Path(os.environ["ORDERS"]).write_text(how["order"] + "\n")
        time.sleep(1)
    with open(here.parent / "said.log", "w+b") as out, open(os.devnull, "wb") as null:
        beside = start(["bash", "-c", how["beside"]], null) if "beside" in how else None
        p = start(words, out)
        limit, wrong, codes = time.monotonic() + PATIENCE, "", range(int(how.get("code", 0)) + 1)
        while p.poll() is None and not ("until" in how and re.search(how["until"], text())):
            if time.monotonic() > limit:
                wrong = "never ends"
                break
            time.sleep(0.05)
        if p.poll() is None:
            codes = (0, 130)
            if not ended(p):
                wrong += "; Ctrl-C does not end it"
        elif "until" in how and not re.search(how["until"], text()):
            wrong = f"never says '{how['until']}'"
        if p.returncode not in codes:
            wrong += f"; exit {p.returncode}"
        if beside:
            ended(beside)
        if "then" in how:
            subprocess.run(["bash", "-c", how["then"]], check=False)
        return wrong and wrong.strip("; ") + ":\n    " + "\n    ".join(text().splitlines()[-8:])


rows = [[part.strip() for part in line.split(" | ")] for line in TABLE.strip().splitlines()]
used, bad = set(), {}  # bad: of each source, what went wrong
for source, command in commands():
    here = world.parent / re.sub("calibrate (dark|flat|noise|gain|colour|spectral)", "light", source)
    if not here.exists():
        shutil.copytree(world, here)
        subprocess.run(FIRST.get(source, "true"), shell=True, cwd=here, check=True)
    hows = {}
    for k, (pattern, how) in enumerate(rows):
        if re.search(pattern, f"{source}: {command}", re.S):
            used.add(k)
            hows.update(h.strip().partition(": ")[::2] for h in how.split("; "))
    bad.setdefault(source, [])
    if "not" in hows or "long" in hows and not LONG:
        continue
    missing = [t for t in re.findall(r"\b(jq|mpirun|arv-tool-0.8)\b", command) if not shutil.which(t)]
    if missing:
        print(f"SKIP 104:{source} (no {missing[0]})")
        continue
    before = sum(os.times()[2:4])
    wrong = paste(command, here, hows)
    print(f"{sum(os.times()[2:4]) - before:5.1f} s of a processor, {source}: {command}", flush=True)
    if wrong:
        bad[source].append(f"  {command}\n    {wrong}\n")
for source, wrong in bad.items():
    print("".join(wrong) + f"{'FAIL' if wrong else 'PASS'} 104:{source}")
for k in set(range(len(rows))) - used if not ONLY else ():
    print(f"FAIL 104:row (no command is '{rows[k][0]}': take it out)")
    bad[rows[k][0]] = 1
sys.exit(any(bad.values()))
