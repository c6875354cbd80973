#!/usr/bin/env python3
"""language.py - measures the English of every page: Markdown, NEWS and manual pages.

    language.py [--table] [FILE ...]

Bounds, per file: at most 4 semicolons per 1000 words, at most 18 words in the mean sentence, no sentence over 45 words.
Headings, tables, code blocks, pictures and link targets are left out.  A code span is one word, as is one macro of
mdoc with its arguments.  A paragraph, a list item and a quotation end a sentence.  It also checks that links lead
somewhere, and that no tracked text refers to a document that is not in the tree.
"""
import os
import re
import subprocess
import sys

SEMICOLONS, MEAN, LONGEST = 4.0, 18.0, 45
END = None                                    # ends a sentence, in a list of words
ABBREVIATION = re.compile(r"^[(\[\"*_]*([A-Z]|e\.g|i\.e|cf|vs|et al|al|vol|no|pp|p|Fig|Figs|Eq|Eqs|Sec|ch|approx|incl)\.$")
STOP = re.compile(r"[.!?][)\]\"'*_»”]*$")


def markdown(text):
    """The words of running text, [(word, line)], with END between sentences that punctuation does not end."""
    words, fence, in_list, comment, before_blank = [], None, False, False, True
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        stripped = line.strip()
        mark = re.match(r"(```+|~~~+)", stripped)
        if fence:
            if mark and stripped.startswith(fence):
                fence = None
            continue
        if mark:
            fence = mark.group(1)
            words.append((END, number))
            continue
        if comment or stripped.startswith("<!--"):
            comment = "-->" not in stripped
            continue
        item = re.match(r"\s*([-*+]|\d+[.)])\s+", line)
        if not stripped or re.match(r"(#+ |\||[-=*_]{3,}$|:?-+:?\|)", stripped) or (" | " in line and table(lines, number - 1)):
            words.append((END, number))
            if stripped.startswith("#"):
                in_list = False
            before_blank = not stripped
            continue
        if line.startswith("    ") and not in_list and before_blank:      # an indented block of code
            continue
        if not line.startswith(" ") and not item:
            in_list = in_list and not before_blank
        if item:
            in_list = True
            words.append((END, number))
            line = line[item.end():]
        before_blank = False
        words += [(w, number) for w in [line.lstrip("> ")]]
    # spans may break over lines: join, with the line's number as a mark that no text contains
    joined = " ".join(f"\0{n}\0 {w}" if w is not END else f"\0{n}\0 \1" for w, n in words)
    joined = re.sub(r"(`+)([^`\1]|(?!\1)`)*?\1", lambda m: " ".join(re.findall(r"\0\d+\0", m.group(0)) + ["Code"]) if "\1" not in m.group(0) else m.group(0), joined)
    joined = re.sub(r"!\[[^\]\1]*\]\([^)\1]*\)", "", joined)
    joined = re.sub(r"\]\([^)\1]*\)", "", joined).replace("[", "")
    joined = re.sub(r"<https?:[^>]*>|https?://\S+", "Link", joined)
    joined = re.sub(r"</?[a-z][^>\0\1]*>|&[a-z]+;", " ", joined)
    return relined(joined)


def table(lines, at):
    """Whether line `at` belongs to a table: a rule of dashes stands among the lines around it."""
    top = at
    while top > 0 and "|" in lines[top - 1]:
        top -= 1
    return top + 1 < len(lines) and re.match(r"[\s|:-]+$", lines[top + 1]) is not None and "-" in lines[top + 1]


def relined(joined):
    number, words = 0, []
    for token in re.sub(r"(\0\d+\0)", r" \1 ", joined).split():
        if token.startswith("\0"):
            number = int(token.strip("\0"))
        elif "\1" in token:
            words.append((END, number))
        else:
            words.append((token, number))
    return words


CODE_MACROS = set("Ad An Ar Cd Cm Dv Er Ev Fa Fd Fl Fn Ft Ic In Li Lk Mt Nm Ms Pa Ql Qq Tn Va Vt Xr Sx St Lb Ux".split())
TEXT_MACROS = set("Ap Aq Bq Brq Do Dc Dq Em No Ns Op Oo Oc Po Pc Pf Pq Qo Qc So Sc Sm Sq Sy Xo Xc Bo Bc Ao Ac".split())
BREAKS = set("Pp Lp El Bl Bd Ed It Sh Ss br sp Rs Re D1 Dl".split())


def mdoc(text):
    words, skip, section = [], None, ""
    for number, line in enumerate(text.split("\n"), 1):
        line = re.sub(r"\\(&|:|\^|\||%|f[A-Z]|f\([A-Z]{2})", "", line)
        line = re.sub(r"\\\((em|en)", "-", re.sub(r"\\(-|e|~| )", r" ", line))
        if re.match(r"\.\\\"|'\\\"", line):
            continue
        macro = line[1:].split()[0] if line.startswith(".") and line[1:].split() else ""
        if skip:
            skip = None if macro == skip else skip
            continue
        if (macro == "Bd" and re.search(r"-(literal|unfilled)", line)) or (macro == "Bl" and "-column" in line) or macro == "TS":
            skip = {"Bd": "Ed", "Bl": "El", "TS": "TE"}[macro]
            words.append((END, number))
            continue
        if macro == "Sh":
            section = line[3:].strip()
        if macro in BREAKS:
            words.append((END, number))
            continue
        if section in ("NAME", "SYNOPSIS", "SEE ALSO", "AUTHORS") or macro in ("Dd", "Dt", "Os", "Nd"):
            continue
        if not line.startswith("."):
            words += [(w, number) for w in line.split()]
            continue
        code = False                          # the arguments of one macro are one word
        for token in re.findall(r'"[^"]*"|\S+', line[1:]):
            token = token.strip('"')
            if token in CODE_MACROS or token in TEXT_MACROS:
                code = token in CODE_MACROS
                if code and not (words and words[-1][0] == "Code"):
                    words.append(("Code", number))
            elif re.fullmatch(r"[.,:;!?)(\[\]|]", token):
                code = False
                if words and words[-1][0] is not END:
                    words[-1] = (words[-1][0] + token, words[-1][1])
            elif not code:
                words += [(w, number) for w in token.split()]
    return words


def sentences(words):
    """[(words, line, text)] of each sentence."""
    found, now, line = [], [], 0
    for i, (word, number) in enumerate(words + [(END, 0)]):
        if word is not END:
            line = line if now else number
            now.append(word)
            after = next((w for w, _ in words[i + 1:i + 2]), END)
            ends = STOP.search(word) and not ABBREVIATION.match(word) and (after is END or not re.match(r"[a-z(]", after))
        if word is END or ends:
            count = sum(1 for w in now if re.search(r"\w", w))
            if count:
                found.append((count, line, " ".join(now)))
            now = []
    return found


def measured(name, text):
    words = mdoc(text) if re.search(r"\.[1-8]$", name) else markdown(text)
    return sentences(words)


def figures(found):
    words = sum(c for c, _, _ in found)
    semicolons = sum(t.count(";") for _, _, t in found)
    longest = max(found, default=(0, 0, ""))
    return words, 1000.0 * semicolons / max(words, 1), words / max(len(found), 1), longest


def faults(name, found):
    words, semicolons, mean, _ = figures(found)
    said = [f"{name}:{line}: a sentence of {count} words, {LONGEST} at most: {text}" for count, line, text in found if count > LONGEST]
    if semicolons > SEMICOLONS:
        said.append(f"{name}: {semicolons:.1f} semicolons per 1000 words, {SEMICOLONS:.0f} at most")
        said += [f"{name}:{line}: a semicolon: {text}" for _, line, text in found if ";" in text]
    if mean > MEAN:
        said.append(f"{name}: {mean:.1f} words in the mean sentence, {MEAN:.0f} at most; the longest:")
        said += [f"{name}:{line}: {count} words: {text}" for count, line, text in sorted(found, reverse=True)[:8]]
    return said


def anchors(text):
    slugs = set()
    for heading in re.findall(r"^#+ +(.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), flags=re.M):
        heading = re.sub(r"\]\([^)]*\)", "", heading)
        slugs.add(re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-"))
    return slugs


def links(name, text, tracked):
    said = []
    plain = re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", lambda m: "\n" * m.group(0).count("\n"), text, flags=re.M | re.S))
    for m in re.finditer(r"\]\(([^)\s]+)\)", plain):
        target, _, anchor = m.group(1).partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        path = os.path.normpath(os.path.join(os.path.dirname(name), target)) if target else name
        line = plain.count("\n", 0, m.start()) + 1
        if not os.path.exists(path) or (os.path.isfile(path) and path not in tracked):
            said.append(f"{name}:{line}: a link to {m.group(1)}, which is not in the tree")
        elif anchor and path.endswith(".md") and anchor not in anchors(open(path, encoding="utf-8").read()):
            said.append(f"{name}:{line}: a link to {m.group(1)}: {path} has no such heading")
    return said


FOREIGN = re.compile(r"\b(DESIGN|STYLE|PAPER|CAPTURE) §?\d|\bof (DESIGN|STYLE)\b|\b[Ii]ssue #?\d")


def foreign(name, text, documents):
    """Lines that refer to documents that are not in the tree."""
    said = []
    for number, line in enumerate(text.split("\n"), 1):
        missing = [w for w in re.findall(r"(?<![\w-])([A-Za-z][\w-]+\.md)\b", line) if w not in documents and w.split("-")[-1] not in documents]
        if missing or FOREIGN.search(line):
            said.append(f"{name}:{number}: refers to {missing[0] if missing else FOREIGN.search(line).group(0)}, which is not in the tree: {line.strip()[:100]}")
    return said


def unnamed_rooms():
    """Rooms of tests/rooms.txt that the table of README.md does not name."""
    readme = open("README.md", encoding="utf-8").read()
    rooms = [line.split()[0] for line in open("tests/rooms.txt", encoding="utf-8") if re.match(r"\w", line)]
    return [f"README.md: the room {room} is not in the table" for room in rooms
            if not re.search(r"`(" + re.escape(room) + "/?|" + os.path.basename(room) + "/?)`", readme)]


def self_test():
    """A checker that finds nothing in a bad text is worth nothing."""
    good = "# Title\n\nOne short sentence; nothing more. See `a; b` and [a page](a;b.md).\n\n    code; code\n\n| a | b |\n|---|---|\n| x; | y |\n\n" + "This is good. " * 100
    assert not faults("x.md", measured("x.md", good)), faults("x.md", measured("x.md", good))
    long = "Good.\n\n- " + "word " * 46 + "end.\n"
    said = faults("x.md", measured("x.md", long))
    assert said and said[0].startswith("x.md:3: a sentence of 47 words"), said
    assert any("semicolons" in s for s in faults("x.md", measured("x.md", "One; two. " * 10)))
    assert any("mean" in s for s in faults("x.md", measured("x.md", ("word " * 20 + "end. ") * 5)))
    assert faults("x.1", measured("x.1", ".Sh DESCRIPTION\nOne\n.Fl Fl x Ar y ;\ntwo.\n"))
    assert [c for c, _, _ in measured("x.1", ".Sh DESCRIPTION\nGive\n.Fl Fl x Ar y .\nNow\n.Xr a 1 ,\nthen stop.\n")] == [2, 4]
    assert foreign("x.c", "/* as NOWHERE.md says */", {"README.md"}) and not foreign("x.c", "/* README.md */", {"README.md"})
    assert links("x.md", "[a](nowhere/b.md)", set())


def main():
    self_test()
    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
    tracked = [f for f in subprocess.run(["git", "ls-files"], capture_output=True, text=True, check=True).stdout.splitlines() if os.path.isfile(f)]
    pages = [f for f in tracked if re.search(r"(\.md|\.[1-8]|^NEWS)$", f)]
    wanted = [a for a in sys.argv[1:] if not a.startswith("-")]
    said, rows = [], []
    for name in pages:
        if wanted and name not in wanted:
            continue
        text = open(name, encoding="utf-8").read()
        found = measured(name, text)
        rows.append((name,) + figures(found))
        said += faults(name, found)
        if name.endswith(".md"):
            said += links(name, text, set(tracked))
    if not wanted:
        said += unnamed_rooms()
        documents = {os.path.basename(f) for f in tracked} | {"live.md"}       # that one is made by tests/bench/run.sh
        for name in tracked:
            if not re.search(r"\.(png|bin|h5|npy|pdf)$|^tests/(fuzz/corpus|data)/", name) and name != "tests/language.py":
                said += foreign(name, open(name, encoding="utf-8", errors="replace").read(), documents)
    if "--table" in sys.argv:
        print("| file | words | semicolons per 1000 | mean sentence | longest, at line |\n|---|--:|--:|--:|--:|")
        for name, words, semicolons, mean, (count, line, _) in rows:
            print(f"| {name} | {words} | {semicolons:.1f} | {mean:.1f} | {count}, {line} |")
        total = sum(r[1] for r in rows)
        print(f"| all | {total} | {sum(r[1] * r[2] for r in rows) / total:.1f} | {total / sum(r[1] / max(r[3], 1) for r in rows):.1f} | {max(r[4][0] for r in rows)} |")
        return 0
    print("\n".join(said)) if said else None
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
