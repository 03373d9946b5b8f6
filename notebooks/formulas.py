# SPDX-License-Identifier: MIT
"""Docstrings in reStructuredText: their formulas are plain text, as sqrt(EI / mu_f) / L."""

import re

GREEK = (
    *("alpha", "beta", "gamma", "delta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "pi"),
    *("rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
)
FUNCTIONS = ("sqrt", "exp", "sin", "cos", "O", "log", "Re", "Im")  # the last three without brackets
TEX = {">=": r"\ge", "<=": r"\le", "->": r"\to", "~": r"\sim", "*": r"\cdot", ".": r"\cdot"}
TEX |= {"..": r"\ldots", "...": r"\ldots"}
UNIT = r"(?:kg|rad|m|s|N)"
SUPERSCRIPTS = str.maketrans("2345", "²³⁴⁵")
MARKUP = r"""(?::\w+(?: [^:\n]*)?:|\.\. .*|[-*] (?=["`*\w]["`*A-Za-z])|>>>.*(?:\n[ ]*\S.*)*)"""
TOKEN = re.compile(
    rf"""(?P<verbatim>^[ ]*{MARKUP}|`+[^`]+`+|"[^"\n]*"|(?<!\w)'\w+'|\b(?:e\.g|i\.e|sec|vol|J)\.)"""
    r"|(?P<number>\d+(?:\.\d+)?(?:e-?\d+)?\b|\.\.\.?(?= \+))"
    r"|(?P<word>[A-Za-z]+(?:_\{[^}]*\}|_[A-Za-z0-9]+)*'*(?!\w))"
    r"|(?P<operator>(?:>=|<=|->|[-+*/=<>~.])(?=\s)|[-/^])"
    rf"|(?P<open>[(|])|(?P<close>\))|(?P<space>[ ]*\n(?![ ]*(?:{MARKUP}|\n))[ ]*|[ ]+)"
    r"|(?P<other>\w+|.|\n)",
    re.MULTILINE,
)


def letter(word):
    """TeX of a word that is a symbol of mathematics; empty if it is a word of the language."""
    name = word.rstrip("'")
    base, _, index = name.partition("_")
    tex = base if len(base) == 1 or base == "EI" else ""
    if base in GREEK or base in ("int", "sum"):
        tex = f"\\{base}"
    elif base != "do" and re.fullmatch("d([A-Za-z]|lambda|tau|theta)", base):
        tex = "d" + letter(base[1:])
    if not tex or (len(index) > 2 and index[0] != "{"):
        return ""
    return tex + (f"_{{{index.strip('{}')}}}" if index else "") + word[len(name) :]


class Reader:
    """Finds formulas among the tokens of a text.

    What reads at a token returns the TeX, empty if there is none, the token that follows, and
    whether this can be nothing but mathematics: "a" and "stiffness" alone are words.
    """

    def __init__(self, text):
        self.tokens = [(one.lastgroup, one[0]) for one in TOKEN.finditer(text) if one[0]]

    def at(self, i):
        """Kind and text of a token; beyond the ends of the text, of an empty one."""
        return self.tokens[i] if 0 <= i < len(self.tokens) else ("other", "")

    def spaced(self, i):
        """The token at i or, if that is a space, the next one; and whether it is."""
        space = self.at(i)[0] == "space"
        return i + space, space

    def comes(self, i, among):
        """Whether one of these comes after a word that ends at i; only ^ needs no space."""
        j, space = self.spaced(i)
        return self.at(j)[1] in among and (space or self.at(j)[1] == "^")

    def argument(self, i, end):
        """What stands in brackets."""
        tex, j, sure = self.formula(i, inside=True, alone=True)
        return (tex, j + 1, sure) if tex and self.at(j)[1] == end else ("", i, False)

    def operand(self, i, glued=False, inside=False):
        """A number, symbol, function or bracket; a word if it is glued to an operator."""
        kind, text = self.at(i)
        if kind == "number":
            return TEX.get(text, text), i + 1, False
        if text == "|":
            tex, j, _ = self.argument(i + 1, "|")
            return (rf"\lvert {tex} \rvert" if tex else ""), j, True
        if text == "(":
            tex, j, sure = self.formula(i + 1, inside=True)
            fits = tex and self.at(j)[0] == "close"
            return (f"({tex})", j + 1, sure) if fits else ("", i, False)
        if kind != "word":
            return "", i, False
        tex = letter(text)
        name = tex or (rf"\{text}" if text.islower() else rf"\mathrm{{{text}}}")
        if (tex or text in FUNCTIONS) and self.at(i + 1)[1] == "(":
            tex, j, _ = self.argument(i + 2, ")")
            shown = f"{{{tex}}}" if text == "sqrt" else f"({tex})"
            return (name + shown if tex else ""), j, True
        if text in FUNCTIONS[5:]:  # Im lambda
            tex, j, sure = self.operand(self.spaced(i + 1)[0])
            return (rf"{name}\, {tex}" if tex and sure else ""), j, True
        if tex:
            return tex, i + 1, text in GREEK or "_" in text or "'" in text
        if glued or self.comes(i + 1, "*^/") or (inside and self.comes(i + 1, "+-<=>=")):
            font = "mathrm" if re.fullmatch(UNIT, text) else "mathit"
            return rf"\{font}{{{text}}}".replace("_", r"\_"), i + 1, False
        if inside and self.at(i + 2)[1] in FUNCTIONS[:5]:
            return rf"\mathit{{{text}}}", i + 1, False
        return "", i, False

    def following(self, i, inside):
        """What continues a formula: an operator with its operand, or a further factor."""
        j, space = self.spaced(i)
        kind, text = self.at(j)
        if kind == "operator":
            k, later = self.spaced(j + 1)
            minus = "-" * (text in "^=" and self.at(k)[1] == "-")
            tight = text == "^" or re.fullmatch(
                r"(d[a-zA-Z]*|\))/d[a-z]+|\d+/\d+", self.at(j - 1)[1] + text + self.at(k)[1]
            )
            one, k, sure = self.operand(k + len(minus), True, inside)
            if one and space == later and (space or tight):
                signed = minus + one
                shown = f"^{{{signed}}}" if text == "^" else f" {TEX.get(text, text)} {signed}"
                return shown, k, sure or text not in "+-=."
        elif inside and text == ",":
            k, _ = self.spaced(j + 1)
            one, end, sure = ("", j + 1, False) if self.at(k)[1] == ")" else self.operand(k)
            if one or self.at(k)[1] == ")":
                return f", {one}".rstrip(), end, sure
        elif space and text != "a" and (kind == "open" or letter(text) or text in FUNCTIONS):
            one, k, sure = self.operand(j, False, inside)
            if one and (sure or kind == "word"):
                return rf"\, {one}", k, sure
        return None

    def formula(self, i, inside=False, alone=False):
        """The longest formula. In brackets words may be summed and, in |.| or f(.), be alone."""
        start, sign, found, sure = i, "", "", False
        if self.at(i)[1] in (">=", "<=", ">", "<", "-"):
            sign = self.at(i)[1]
            i, space = self.spaced(i + 1)
            if space == (sign == "-"):
                return "", start, False
            found, sure = f"{TEX.get(sign, sign)} ", sign != "-"
        more = self.operand(i, alone or sign == "-", inside)
        if not more[0]:
            return "", start, False
        while more:
            found, i, sure = found + more[0], more[1], sure or more[2]
            more = self.following(i, inside)
        return found, i, sure

    def is_symbolic(self, i, end):
        """Whether letters and numbers mean mathematics: they are neither articles nor units."""
        words = [self.at(k)[1] for k in range(i, end) if self.at(k)[0] == "word"]
        kind, before = self.at(i - 2)
        followed = self.at(end)[1].strip() not in ("", *",.;:)]")
        if followed or not all(letter(word) for word in words):
            return False
        if words in ([], ["a"], ["I"], ["sum"]) or (words == ["A"] and before in ".\n:"):
            return False
        physical = ("kg", "in", "and", "or", "to", "per", ",", "N", "m", "s")
        measured = "number" in (kind, self.at(i)[0])  # 10 s
        alone = len(words) == 1 and not measured and before not in physical
        shape = self.at(i)[1] == "(" and any(self.at(k)[1] == "," for k in range(i, end))
        related = shape or any(self.at(k)[0] == "operator" for k in range(i, end))
        return alone or related or not {*words} & {"m", "s", "N"}

    def pieces(self):
        """Pieces of the text in their order, each with its kind, "formula" if it is in TeX."""
        i = 0
        while i < len(self.tokens):
            kind, text = self.at(i)
            before = self.at(i - 1)
            apart = (
                before[0] in ("space", "verbatim")
                or before[1] in "[\n"
                or (before[0] == "open" and self.at(i - 2)[0] != "word")
            )
            tex, end, sure = self.formula(i) if apart else ("", i, False)
            words = (self.at(i - 2)[1], text) == ("a", "lambda") or (
                text == "a" and self.at(i + 2)[1] != "u"
            )
            ends = self.at(end)[1][:1] in ("", *" \n'\")]>-/:.,;!?|")  # as the markup wants
            if tex and ends and not words and (sure or self.is_symbolic(i, end)):
                yield tex, "formula"
                i = end
            else:
                yield text, kind
                i += 1


def marked(text):
    """Text of a docstring in reStructuredText: `code` is a literal, formulas and units are set."""
    units = rf"\b{UNIT}(?:[/ ]{UNIT})*\^[2-5](?![\w^])"
    text = re.sub(units, lambda one: one[0][:-2] + one[0][-1].translate(SUPERSCRIPTS), text)
    found = ""
    for piece, kind in Reader(text).pieces():
        if kind == "formula":
            found += f":math:`{piece}`"
        elif piece.startswith("`"):
            found += f"``{piece.strip('`')}``"
        else:
            found += piece if kind == "verbatim" else re.sub(r"[|*]", r"\\\g<0>", piece)
    return found


def alone(text):
    """TeX of a text that is a formula and nothing else but the comma or stop at its end, or ""."""
    reader = Reader(text.strip().rstrip(",."))
    tex, end, _ = reader.formula(0)
    return tex if end == len(reader.tokens) else ""
