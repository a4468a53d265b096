"""Words of a text by their places, all at once, so that single numbers can be read and replaced."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Splice", "Words", "spelled"]

Places = NDArray[np.int64]

NEWLINE, SPACE = ord("\n"), ord(" ")
BLANK = np.zeros(256, dtype=bool)
BLANK[[9, 10, 11, 12, 13, 32]] = True


class Words:
    """What stands between blanks in `data` from `begin` on: word i is data[starts[i]:ends[i]].

    comment: from this to the end of a line there are no words. joined: a backslash at the end of a line is blank, and
    the line goes on. Lines without words do not count; `first` has the number of the first word of each line.
    """

    def __init__(self, data: bytes, begin: int = 0, *, comment: bytes = b"", joined: bool = False) -> None:
        self.data, self.begin = data, begin
        self._buffer = np.frombuffer(data, dtype=np.uint8)[begin:]
        blank = BLANK[self._buffer]
        ends_line = self._buffer == NEWLINE
        if joined and data.find(b"\\", begin) >= 0:
            for match in re.compile(rb"\\\r?\n").finditer(data, begin):
                blank[match.start() - begin], ends_line[match.end() - 1 - begin] = True, False
        if comment and data.find(comment, begin) >= 0:
            for match in re.compile(re.escape(comment) + rb"[^\n]*").finditer(data, begin):
                blank[match.start() - begin : match.end() - begin] = True
        edges = np.flatnonzero(blank[1:] != blank[:-1]) + 1
        if len(blank):
            edges = np.concatenate([[0] * (not blank[0]), edges, [len(blank)] * (not blank[-1])]).astype(np.int64)
        self.starts: Places = edges[0::2] + begin
        self.ends: Places = edges[1::2] + begin
        next_words = np.searchsorted(edges[0::2], np.concatenate([[0], np.flatnonzero(ends_line)]))
        next_words = next_words[next_words < len(self)]
        self.first: Places = next_words[np.diff(next_words, prepend=-1) > 0]  # without empty lines

    def __len__(self) -> int:
        return len(self.starts)

    def counts(self) -> Places:
        """The number of words in each line."""
        return np.diff(self.first, append=len(self))

    def firsts(self, word: bytes) -> NDArray[np.bool_]:
        """The lines (mask) whose first word is this one."""
        starts, lengths = self.starts[self.first], (self.ends - self.starts)[self.first]
        found = lengths == len(word)
        for place, letter in enumerate(word):
            found[found] = self._buffer[starts[found] + place - self.begin] == letter
        return found

    def texts(self, starts: Places, ends: Places) -> NDArray[np.bytes_]:
        """The bytes between places of `data`, blanks and all, as an array of texts."""
        lengths = ends - starts
        columns = np.arange(max(int(lengths.max(initial=1)), 1))
        inside = columns < lengths[:, None]
        letters = np.zeros(inside.shape, dtype=np.uint8)
        letters[inside] = self._buffer[(starts[:, None] + columns - self.begin)[inside]]
        return letters.view(f"S{len(columns)}").ravel()

    def floats(self, numbers: Places) -> NDArray[np.float64]:
        """The words of these numbers (any shape) as float64; ValueError where one is no number."""
        starts, ends = self.starts[numbers], self.ends[numbers]
        if numbers.ndim == 2 and (starts[:, 1:] - ends[:, :-1] == 1).all():
            starts, ends = starts[:, 0], ends[:, -1]  # as one piece
        pieces = map(slice, starts.ravel().tolist(), ends.ravel().tolist())
        values = np.fromstring(b" ".join(map(self.data.__getitem__, pieces)), dtype=np.float64, sep=" ")
        if values.size != numbers.size:
            raise ValueError("a word is no number")
        return values.reshape(numbers.shape)


class Splice:
    """Places of a file and what is to stand there instead."""

    def __init__(self) -> None:
        self._starts: list[Places] = []
        self._ends: list[Places] = []
        self._texts: list[bytes] = []

    def replace(self, starts: Places, ends: Places, texts: Sequence[bytes]) -> None:
        """Put these texts (n) between these places (n,); starts = ends inserts."""
        self._starts.append(starts)
        self._ends.append(ends)
        self._texts.extend(texts)

    def respell(self, words: Words, places: Places, values: NDArray[np.floating]) -> None:
        """Put numbers (n, k) instead of the words with these numbers (n, k); what stands between them stays."""
        starts, ends = words.starts[places], words.ends[places]
        letters = np.frombuffer(words.data, dtype=np.uint8)
        if (starts[:, 1:] - ends[:, :-1] == 1).all() and (letters[ends[:, :-1]] == SPACE).all():
            # The usual file: a row is one piece, which saves most of the time.
            texts = iter(spelled(values))
            self.replace(starts[:, 0], ends[:, -1], list(map(b" ".join, zip(*[texts] * values.shape[1], strict=True))))
        else:
            self.replace(starts.ravel(), ends.ravel(), spelled(values))

    def on(self, data: bytes) -> bytes:
        """The file with everything replaced; the same object where nothing is."""
        if not self._texts:
            return data
        starts, ends = np.concatenate(self._starts), np.concatenate(self._ends)
        order = np.argsort(starts, kind="stable")
        parts: list[bytes] = []
        at = 0
        for start, end, number in zip(starts[order].tolist(), ends[order].tolist(), order.tolist(), strict=True):
            parts += (data[at:start], self._texts[number])
            at = end
        return b"".join([*parts, data[at:]])


def spelled(values: NDArray[np.floating]) -> list[bytes]:
    """Numbers (any shape) in the fewest digits that give the same bits again."""
    flat = values.ravel()
    if flat.dtype.itemsize == 8:
        return "\n".join(map(repr, flat.tolist())).encode().split(b"\n") if len(flat) else []
    texts: list[bytes] = flat.astype("S32").tolist()
    return texts
