#!/usr/bin/env python3
"""Makes an animated SVG of terminal screens.

frames_to_svg.py COLUMNS LINES SECONDS STILL FRAME... > OUT.svg

A FRAME is a file as `tmux capture-pane -e -p` prints it: text with SGR escapes. Each is shown for
SECONDS, in a loop. STILL is the number of the frame, from 1, that is shown without animation: by a
viewer that does not animate, or for a reader who has switched animations off.
"""
import re
import sys
from html import escape

COLOURS = ["#1e1e1e", "#cd3131", "#0dbc79", "#e5e510", "#2472c8", "#bc3fbc", "#11a8cd", "#e5e5e5"]
BRIGHT = ["#666666", "#f14c4c", "#23d18b", "#f5f543", "#3b8eea", "#d670d6", "#29b8db", "#ffffff"]
TEXT, GROUND = "#d4d4d4", "#1e1e1e"
WIDTH, HEIGHT, SIZE = 8.43, 17, 14


def indexed(number):
    if number < 8:
        return COLOURS[number]
    if number < 16:
        return BRIGHT[number - 8]
    if number < 232:
        levels = [0, 95, 135, 175, 215, 255]
        number -= 16
        red, green, blue = number // 36, number // 6 % 6, number % 6
        return "#%02x%02x%02x" % (levels[red], levels[green], levels[blue])
    grey = 8 + 10 * (number - 232)
    return "#%02x%02x%02x" % (grey, grey, grey)


class Style:
    def __init__(self):
        self.reset()

    def reset(self):
        self.fore, self.back = None, None
        self.bold, self.dim, self.reverse = False, False, False

    def apply(self, codes):
        codes = [int(code or 0) for code in codes.split(";")]
        while codes:
            code = codes.pop(0)
            if code == 0:
                self.reset()
            elif code in (1, 2, 7):
                setattr(self, {1: "bold", 2: "dim", 7: "reverse"}[code], True)
            elif code == 22:
                self.bold = self.dim = False
            elif code == 27:
                self.reverse = False
            elif 30 <= code < 38:
                self.fore = COLOURS[code - 30]
            elif 90 <= code < 98:
                self.fore = BRIGHT[code - 90]
            elif 40 <= code < 48:
                self.back = COLOURS[code - 40]
            elif 100 <= code < 108:
                self.back = BRIGHT[code - 100]
            elif code in (38, 48) and codes:
                kind = codes.pop(0)
                if kind == 5:
                    colour = indexed(codes.pop(0))
                else:
                    colour = "#%02x%02x%02x" % (codes.pop(0), codes.pop(0), codes.pop(0))
                if code == 38:
                    self.fore = colour
                else:
                    self.back = colour
            elif code == 39:
                self.fore = None
            elif code == 49:
                self.back = None

    def colours(self):
        fore, back = self.fore or TEXT, self.back or GROUND
        return (back, fore) if self.reverse else (fore, back)


def frame(path, lines):
    """The lines of a screen, each as SVG."""
    style, out = Style(), []
    with open(path, encoding="utf-8") as file:
        rows = file.read().split("\n")[:lines]
    for number, row in enumerate(rows):
        column, line = 0, []
        y = (number + 1) * HEIGHT - 4
        for part in re.split("(\x1b\\[[0-9;]*m)", row):
            if part.startswith("\x1b["):
                style.apply(part[2:-1])
                continue
            if not part:
                continue
            fore, back = style.colours()
            x, length = column * WIDTH, len(part) * WIDTH
            if back != GROUND:
                line.append(
                    f'<rect x="{x:.1f}" y="{number * HEIGHT}" width="{length:.1f}" '
                    f'height="{HEIGHT}" fill="{back}"/>'
                )
            looks = f' fill="{fore}"'
            looks += ' font-weight="bold"' if style.bold else ""
            looks += ' opacity="0.6"' if style.dim else ""
            # Words with more than a space between them are placed one by one: a font of another
            # width moves none of the columns.
            for words in re.finditer(r"\S+(?: \S+)*", part):
                x, length = (column + words.start()) * WIDTH, len(words[0]) * WIDTH
                line.append(
                    f'<text x="{x:.1f}" y="{y}" textLength="{length:.1f}"{looks}>{escape(words[0])}</text>'
                )
            column += len(part)
        out.append("\n".join(line))
    return out + [""] * (lines - len(out))


def main():
    columns, lines, seconds, still = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
    frames = [frame(path, lines) for path in sys.argv[5:]]
    width, height = columns * WIDTH, lines * HEIGHT + 6
    total, share = seconds * len(frames), 100 / len(frames)
    print(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height}" '
        f'font-family="monospace" font-size="{SIZE}">'
    )
    # Negative delays: from the beginning on exactly one frame is shown. Without the animation the
    # attributes hold, of which one is "visible".
    print(
        "<style>@media (prefers-reduced-motion:no-preference){.f{animation:show %.2fs step-end infinite}}"
        "@keyframes show{0%%{visibility:visible}%.4f%%,100%%{visibility:hidden}}</style>" % (total, share)
    )
    print(f'<rect width="100%" height="100%" fill="{GROUND}" rx="6"/>')
    same = [len(set(rows)) == 1 for rows in zip(*frames)]
    print("\n".join(row for row, always in zip(frames[0], same) if always and row))
    for number, rows in enumerate(frames):
        seen = "visible" if number + 1 == still else "hidden"
        delay = number * seconds - total
        changing = "\n".join(row for row, always in zip(rows, same) if not always and row)
        print(f'<g class="f" visibility="{seen}" style="animation-delay:{delay:.2f}s">\n{changing}\n</g>')
    print("</svg>")


main()
