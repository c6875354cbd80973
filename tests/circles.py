#!/usr/bin/env python3
"""Find files of a room that depend on each other in a circle: circles.py BUILD

A file depends on a header that it includes, and on a source file whose functions or data it uses, as its
object says.  A circle of more than two files fails."""
import collections, os, re, subprocess, sys

build = sys.argv[1]
rooms = [l.split()[0] for l in open("tests/rooms.txt") if re.match(r"[a-z]", l)]


def symbols(objects):
    """Symbols that each object defines, and those that it uses."""
    defined, used, at = collections.defaultdict(set), collections.defaultdict(set), None
    for line in subprocess.run(["nm", "-A"] + objects, stdout=subprocess.PIPE, check=True, text=True).stdout.splitlines():
        path, rest = line.split(":", 1)
        kind, name = rest.split()[-2:]
        if kind in "Uw":
            used[path].add(name)
        elif kind.isupper():
            defined[path].add(name)
    return defined, used


def circles(edges):
    """Strongly connected components with more than one member (Tarjan)."""
    index, low, stack, found = {}, {}, [], []

    def visit(v):
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in edges[v]:
            if w not in index:
                visit(w)
            if w in stack:
                low[v] = min(low[v], low[w])
        if low[v] == index[v]:
            members = stack[stack.index(v):]
            del stack[stack.index(v):]
            found.append(sorted(members))

    for v in list(edges):
        if v not in index:
            visit(v)
    return [m for m in found if len(m) > 1]


sources = subprocess.run(["git", "ls-files", "*.c", "*.h", "*.cpp"], stdout=subprocess.PIPE, text=True).stdout.split()
bad = 0
for room in rooms:
    files = [f for f in sources if os.path.dirname(f) == room]
    if not files:
        continue
    edges = collections.defaultdict(set)
    for f in files:
        for line in open(f):
            m = re.match(r'#include "(.*)"', line)
            if m:
                edges[f] |= {h for h in (m[1], "daemon/" + m[1]) if h in files}
    source = {f"{build}/{os.path.splitext(f)[0]}.o": f for f in files if not f.endswith(".h")}
    objects = [o for o in source if os.path.exists(o)]
    if source and not objects:
        sys.exit(f"circles: {build} has no objects of {room}: run make first")
    defined, used = symbols(objects) if objects else ({}, {})
    home = {s: source[o] for o in objects for s in defined[o]}
    for o in objects:
        edges[source[o]] |= {home[s] for s in used[o] if s in home}
    found = [c for c in circles(edges) if len(c) > 2]
    if found:
        bad = 1
    for c in found:
        print(f"{room}: {len(c)} files depend on each other in a circle: {' '.join(map(os.path.basename, c))}")
sys.exit(bad)
