"""Recordings that roll over on a disk that fills: each file is read when it is closed, and then it makes room."""
import glob, os
import h5py
import lab

kept, checked, told = 0.5, {"raw": 0, "volumes": 0}, {"raw": 0, "volumes": 0} # share of the disk; sets in files; sets in gaps
ends, files = {}, {"raw": 0, "volumes": 0} # by recording: the last set that one of its files tells of

def series(path):
    """A file's recording, and its place in that: NAME-0002.h5 is NAME's second."""
    stem = os.path.basename(path)[:-3]
    head, _, part = stem.rpartition("-")
    return (head, int(part)) if head and len(part) == 4 and part.isdigit() else (stem, 1)

def look(kind, path):
    try: f = h5py.File(path, "r")
    except OSError as e: # goes on: what else happens in these hours is wanted too
        lab.wrong.append("%s: %s" % (path, e))
        return []
    with f:
        if f.attrs["closed"] != 1: lab.wrong.append("%s was not closed" % path)
        if kind == "raw":
            there = [int(n) for n in f["sets"]["number"]]
            gaps = [(int(g["set_first"]), int(g["set_last"])) for g in f["gaps"][:] if g["set_first"] >= 0]
        else:
            there = [int(n) for n in f["sets/number"]]
            gaps = [(int(a), int(b)) for a, b in zip(f["gaps/set_first"], f["gaps/set_last"])]
    missing = {n for a, b in gaps for n in range(a, b + 1)} - set(there)
    known = sorted(set(there) | missing)
    if there != sorted(set(there)): lab.wrong.append("%s: its sets do not ascend" % path)
    checked[kind] += len(there); told[kind] += len(missing); files[kind] += 1
    return known

def account(kind, path, published):
    """No set between two files of a recording, or between two sets of a file, that is not told of: of raw frames all, of
    volumes those that the steady subscriber saw."""
    known = look(kind, path)
    if not known: return
    recording, part = series(path)
    first = ends.get(recording, (part - 1, known[0] - 1))
    if first[0] != part - 1: lab.wrong.append("%s: no file before it" % path)
    wanted = range(first[1] + 1, known[-1] + 1)
    if kind == "volumes": wanted = [n for n in wanted if n in published]
    lost = set(wanted) - set(known)
    if lost: lab.wrong.append("%s: %d sets are neither there nor told to be missing, from %d on" % (path, len(lost), min(lost)))
    ends[recording] = (part, known[-1])

def share_free():
    v = os.statvfs(lab.disk)
    return v.f_bavail / v.f_blocks

def listed(kind):
    return sorted(glob.glob("%s/%s-*.h5" % (lab.disk, kind)), key=lambda p: os.stat(p).st_mtime_ns)

def tend(published, all_of_them=False):
    """Begins what has ended, if there is room; reads what is closed, oldest first, and then lets it go."""
    files_of = {kind: listed(kind) for kind in files} # before the question: a file that begins after the answer is none of these
    state = lab.ask(cmd="status")
    runs = {"raw": state["record"]["state"] == "recording", "volumes": state["record_volumes"]["running"]}
    for kind in runs:
        there = files_of[kind]
        for path in there[:len(there) - runs[kind]]: # the last is being written
            if all_of_them or share_free() < kept:
                account(kind, path, published)
                os.unlink(path)
    return [k for k in runs if not runs[k]] if share_free() > kept / 2 else []
