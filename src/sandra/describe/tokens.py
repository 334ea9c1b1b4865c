"""How long a prompt is, in tokens.

Each model counts with a tokenizer of its own. Without it, a token is taken as 3.6 characters: of
the prompts of our eight scenarios, OpenAI's cl100k_base makes tokens of 3.5 to 3.9 characters, as
numbers are short. A picture is taken as its patches of 32 x 32 pixels.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass

from sandra.describe.types import Prompt

CHARACTERS = 3.6
"""Characters of a token, where nobody counts."""
PATCH = 32
"""Side of a patch of a picture that becomes a token [pixel]."""


@dataclass(frozen=True, slots=True)
class Tokens:
    """Tokens of system and user text, of the schema, and of the picture."""

    text: int
    schema: int
    picture: int
    exact: bool
    """Whether text and schema were counted by the model's own tokenizer."""

    def __str__(self) -> str:
        parts = [f"text {self.text}", f"schema {self.schema}"]
        if self.picture:
            parts.append(f"picture about {self.picture}")
        how = "the model's tokenizer" if self.exact else f"{CHARACTERS} characters each"
        about = "" if self.exact and not self.picture else "about "
        total = self.text + self.schema + self.picture
        return f"{about}{total} tokens ({', '.join(parts)}; {how})"


def tokens(prompt: Prompt, count: Callable[[str], int] | None = None) -> Tokens:
    """The length of a prompt; `count` is a model's own count of a text's tokens."""

    def of(text: str) -> int:
        return math.ceil(len(text) / CHARACTERS) if count is None else count(text)

    picture = prompt.picture
    patches = 0
    if picture is not None:
        patches = math.ceil(picture.width / PATCH) * math.ceil(picture.height / PATCH)
    text = of(f"{prompt.system}\n{prompt.user}")
    return Tokens(text, of(json.dumps(prompt.schema)), patches, count is not None)
