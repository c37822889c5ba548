"""The one exception for bad input: it names the file, the place in it and what was expected."""


class BadInput(Exception):
    """Input that cannot be used. The command prints `str(error)` as one line and exits with status 2.

    Parameters: `source` the file or option, `place` the line, key or byte offset in it (may be empty),
    `expected` what would have been right, with the value found.
    """

    def __init__(self, source: object, place: str, expected: str) -> None:
        self.source, self.place, self.expected = str(source), place, expected
        super().__init__(": ".join(part for part in (self.source, place, expected) if part))
