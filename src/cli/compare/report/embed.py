# SPDX-License-Identifier: MIT
"""Makes one page of report.html, report.css and the scripts, in their order, and writes it as a C file: embed.py HTML CSS JS... OUT.

The page's policy names the hashes of its own style and script: nothing else runs in it, whatever names a scene brings, and nothing is
fetched. Marks in the page: @STYLE@ and @SCRIPT@, their hashes @STYLE-HASH@ and @SCRIPT-HASH@, and @TITLE@ and @DATA@, which the program
fills: there the text is cut.
"""
import base64
import hashlib
import re
import sys


def source_hash(text):
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def rows(name, text):
    data = text.encode("utf-8") + b"\0"
    lines = [f"const char {name}[{len(data)}] = {{\n"]
    for i in range(0, len(data), 24):
        lines.append("    " + " ".join(f"{b - 256 if b > 127 else b}," for b in data[i:i + 24]) + "\n")
    return "".join(lines) + "};\n"


def read(path):
    """A source without its licence line: that is not the reader's affair."""
    with open(path, encoding="utf-8") as file:
        return re.sub(r"\A(/\*.*?\*/|//[^\n]*)\n", "", file.read(), flags=re.DOTALL).strip()


def main():
    page, style = read(sys.argv[1]), read(sys.argv[2])
    script = "\n\n".join(read(path) for path in sys.argv[3:-1])
    page = re.sub(r"<!-- SPDX.*?-->\n", "", page, flags=re.DOTALL)
    for text, closing in ((style, "</style"), (script, "</script")):
        if closing in text.lower() or "@DATA@" in text or "@TITLE@" in text:
            sys.exit(f"{closing}>, @DATA@ and @TITLE@ can't stand in it")
    marks = (("@STYLE-HASH@", source_hash(style)), ("@SCRIPT-HASH@", source_hash(script)), ("@STYLE@", style), ("@SCRIPT@", script))
    for mark, text in marks:
        if page.count(mark) != 1:
            sys.exit(f"{mark} must stand in the page once")
        page = page.replace(mark, text)
    head, rest = page.split("@TITLE@")
    body, end = rest.split("@DATA@")
    with open(sys.argv[-1], "w", encoding="ascii") as out:
        out.write("/* Made by embed.py. */\nextern const char report_page_head[], report_page_body[], report_page_end[];\n\n")
        out.write(rows("report_page_head", head) + "\n" + rows("report_page_body", body) + "\n" + rows("report_page_end", end + "\n"))


main()
