"""Enhancement states: one digit per slot of a graph, and the hypercube that they span (paper, section 4.1).

Digit 0 is the first choice of a slot, usually its original term or operator; the others are networks of given sizes and
other analytic terms (m-ary digits; the paper's are binary).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

from ..analytic.alternative_terms import with_terms
from ..analytic.models.model import Model
from ..neural.enhance import enhance
from ..neural.enhanced_brdf import EnhancedBRDF
from ..neural.mlp import check_sizes

State = tuple[int, ...]
# The content of a slot: None (the original), hidden sizes of a network, or the name of another analytic term.
Choice = None | tuple[int, ...] | str


def choices(
    model: Model,
    *,
    modules: Sequence[Sequence[int]] = ((16, 32, 16),),
    alternatives: Mapping[str, Sequence[str]] | None = None,
    fixed: Mapping[str, str] | None = None,
    nodes_only: bool = False,
) -> dict[str, tuple[Choice, ...]]:
    """Return the choices of every slot of a model.

    Parameters
    ----------
    model : Model
    modules : sequence of sequences of int
        Hidden sizes of the modules to choose from.
    alternatives : dict of str to list of str, optional
        Slot -> names of other analytic terms, see :data:`mi_enhance.analytic.alternative_terms.ALTERNATIVES`.
    fixed : dict of str to str, optional
        Slot -> ``"analytic"`` or ``"neural"``: the digits the search leaves alone, or lets choose among networks.
    nodes_only : bool
        Leave operators as they are.

    Returns
    -------
    dict of str to tuple
        By slot, in the order of the formula.

    Raises
    ------
    ValueError, KeyError
        For an unknown slot, term or word.

    Examples
    --------
    >>> from mi_enhance import models
    >>> choices(models.get("ward"), nodes_only=True, fixed={"M": "analytic"}, alternatives={"D": ["D_ggx"]})["D"]
    (None, (16, 32, 16), 'D_ggx')
    """
    alternatives, fixed = alternatives or {}, fixed or {}
    sizes: tuple[Choice, ...] = tuple(check_sizes(hidden, "choices(): modules") for hidden in modules)
    for slot in (*alternatives, *fixed):
        model.graph.find(slot)
    for slot, word in fixed.items():
        if word not in ("analytic", "neural"):
            raise ValueError(f'choices(): fixed["{slot}"] is {word!r}; it must be "analytic" or "neural".')
    result: dict[str, tuple[Choice, ...]] = {}
    for node in model.graph.walk():
        networks = () if nodes_only and node.args else sizes
        terms = tuple(alternatives.get(node.name, ()))
        result[node.name] = {
            None: (None, *networks, *terms),
            "analytic": (None, *terms),
            "neural": sizes,
        }[fixed.get(node.name)]
        for term in terms:
            with_terms(model, {node.name: term})  # raises if it cannot stand here
    return result


def neighbours(
    state: State, choices: Mapping[str, Sequence[Choice]], *, distance: int = 1, max_modules: int | None = None
) -> list[State]:
    """Return `state` itself and all states that differ from it in at most `distance` slots (Hamming; section 4.2).

    Examples
    --------
    >>> from mi_enhance import models
    >>> len(neighbours((0,) * 11, choices(models.get("ggx"))))
    12
    >>> len(neighbours((0,) * 11, choices(models.get("ggx")), distance=2))
    67
    """
    options = list(choices.values())
    found = [state]
    for d in range(1, distance + 1):
        for slots in itertools.combinations(range(len(state)), d):
            others = [[k for k in range(len(options[s])) if k != state[s]] for s in slots]
            for digits in itertools.product(*others):
                changed = list(state)
                for s, digit in zip(slots, digits, strict=True):
                    changed[s] = digit
                found.append(tuple(changed))
    if max_modules is not None:
        n = lambda s: sum(isinstance(c, tuple) for _, c in chosen(s, choices))  # noqa: E731
        found = [s for s in found if s == state or n(s) <= max_modules]
    return found


def chosen(state: State, choices: Mapping[str, Sequence[Choice]]) -> Iterator[tuple[str, Choice]]:
    """Yield the slots that do not hold their original, with their contents."""
    for digit, (slot, options) in zip(state, choices.items(), strict=True):
        if options[digit] is not None:
            yield slot, options[digit]


def brdf_of(model: Model, state: State, choices: Mapping[str, Sequence[Choice]], **settings) -> EnhancedBRDF:
    """Return the BRDF of a state, with Xavier weights; `settings` are those of :func:`.neural.enhance.enhance`.

    Examples
    --------
    >>> from mi_enhance import models
    >>> print(brdf_of(models.get("ward"), (0, 0, 0, 0, 1, 0, 1), choices(models.get("ward")), inputs="shape"))
    M + S * [D] * [1/E]
    """
    picked = dict(chosen(state, choices))
    model = with_terms(model, {slot: c for slot, c in picked.items() if isinstance(c, str)})
    return enhance(model, {slot: c for slot, c in picked.items() if isinstance(c, tuple)}, **settings)


def state_digits(state: State) -> str:
    """Return the digits of a state as a text that can name a folder.

    Examples
    --------
    >>> state_digits((0, 1, 0)), state_digits((0, 12, 0))
    ('010', '0-12-0')
    """
    return ("" if max(state) < 10 else "-").join(map(str, state))


def describe_change(before: State, after: State, choices: Mapping[str, Sequence[Choice]]) -> str:
    """Return the change from one state to another in words.

    Examples
    --------
    >>> from mi_enhance import models
    >>> describe_change((0, 0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0, 1), choices(models.get("ward")))
    '[1/E]'
    """
    words = []
    for a, b, (slot, options) in zip(before, after, choices.items(), strict=True):
        if a != b:
            words.append(_word(slot, options, b))
    return ", ".join(words) or "unchanged"


def _word(slot: str, options: Sequence[Choice], digit: int) -> str:
    choice = options[digit]
    if choice is None:
        return f"{slot} reverted"
    if isinstance(choice, str):
        return choice
    n_networks = sum(isinstance(c, tuple) for c in options)
    return f"[{slot}]" if n_networks == 1 else f"[{slot}] {'x'.join(map(str, choice))}"
