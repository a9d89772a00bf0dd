"""A reflectance model from a TOML text: the formula, its terms as expressions, its parameters. See docs/files.md.

The rest of the package relies on two properties, which are checked here, once. f is linear in the colours and each
colour stands in one term, so edits, fits and :mod:`mi_enhance.material.colour_normalization` may scale it; rho_d is the
diffuse albedo and M the diffuse term.
"""

from __future__ import annotations

import dataclasses
import keyword
import re
import sys
from collections.abc import Iterable, Mapping

import drjit as dr

from ...system.messages import did_you_mean
from .. import parameters
from ..geometry import QUANTITIES
from ..graph import Node
from ..lobes import LOBES, OWN
from ..parameters import Parameter
from . import expression
from .expression import MAX_NUMBER, Expression, shown

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# Characters (a key of many dots costs time as their square); terms, parameters, starts; parentheses in the formula.
_MAX_TEXT, _MAX_ITEMS, _MAX_DEPTH = 10_000, 40, 20
_TAKEN = {
    *(*QUANTITIES, *expression.RESERVED, *parameters.FRAME, "latent", "asymmetry"),
    *("type", "id", "filename", "description", "params", "weights"),  # of the plugin's dictionary
}
# Sampling, modules and alternative terms read these by name: their meaning is fixed.
_STANDARD = {q.name: q for q in vars(parameters).values() if isinstance(q, Parameter) and q.name not in _TAKEN}
_KEYS = ("name", "source", "formula", "frame", "v_cavity", "terms", "parameters", "starts", "lobes")


def parse(text: str, where: str) -> dict:
    """Read a model.

    Parameters
    ----------
    text : str
        TOML.
    where : str
        Start of an error message.

    Returns
    -------
    dict
        The fields of :class:`mi_enhance.analytic.models.model.Model` that the text says something about.

    Raises
    ------
    ValueError
        For anything that is not a model: where, what, what is allowed, what to do.
    """
    if not isinstance(text, str) or len(text) > _MAX_TEXT:
        raise ValueError(f"{where}: a model is a text of at most {_MAX_TEXT} characters; got {shown(text)}.")
    try:
        given = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # RecursionError: ten thousand opening brackets
        raise ValueError(f"{where}: this is not TOML ({error}). The format is described in docs/files.md.") from None
    _only(given, _KEYS, where)
    name = _get(given, "name", str, where)
    if not re.fullmatch(r"[A-Za-z]\w{0,63}", name, re.ASCII):
        raise ValueError(f'{where}: name must be letters, digits and "_", at most 64; got "{name[:80]}".')
    own = {q: _parameter(q, v, where) for q, v in _table(given, "parameters", where).items()}
    frame = (parameters.N_X, parameters.N_Y, parameters.T_THETA) if _get(given, "frame", bool, where, False) else ()
    all_parameters = (*frame, *own.values())
    kinds = {q.name: "colour" if q.is_colour else "number" for q in own.values()}
    terms = {
        slot: expression.parse(v, {**QUANTITIES, **kinds}, f"{where}: [terms] {slot[:60]}")
        for slot, v in _table(given, "terms", where).items()
    }
    graph = _graph(_get(given, "formula", str, where), terms, f"{where}: formula")
    _check_terms(terms, kinds, where)
    _check_linear(graph, terms, f"{where}: formula")
    fields = {
        "name": name,
        "source": _get(given, "source", str, where, ""),
        "graph": graph,
        "parameters": all_parameters,
        "v_cavity": _get(given, "v_cavity", bool, where, False),
    }
    starts = _tables(given, "starts", where)
    if starts or "alpha_x" not in kinds:  # else the roughnesses from which GGX starts, too
        fields["starts"] = tuple(_start(s, all_parameters, f"{where}: [[starts]]") for s in starts or [{}])
    lobes = _tables(given, "lobes", where)
    if lobes:
        fields["lobes"] = _lobes([_lobe(v, kinds, f"{where}: [[lobes]]") for v in lobes])
    elif missing := [q for q in OWN if q not in kinds]:
        raise ValueError(
            f"{where}: [[lobes]] is missing, and the model has no {', '.join(missing)}. Say which GGX lobes cover its "
            'own, for sampling: rho_s = "...", alpha_x = "...", alpha_y = "...".'
        )
    return fields


# --- what is in a table -----------------------------------------------------------------------------------------------


def _get(table: Mapping, key: str, kind: type, where: str, default=None):
    value = table.get(key, default)
    if type(value) is not kind:
        what = {str: 'a text in quotes "..."', bool: "true or false"}[kind]
        raise ValueError(f"{where}: {key} must be {what}; got {shown(value)}.")
    return value


def _only(table: Mapping, keys: Iterable[str], where: str) -> None:
    for key in table:
        if key not in keys:
            hint = did_you_mean(key, keys)
            raise ValueError(f'{where}: unknown entry "{key[:60]}". Choose from: {", ".join(keys)}.{hint}')


def _table(given: Mapping, key: str, where: str) -> dict:
    value = given.get(key)
    if not isinstance(value, dict) or not 0 < len(value) <= _MAX_ITEMS:
        raise ValueError(f"{where}: [{key}] must be a table of 1 to {_MAX_ITEMS} entries; got {shown(value)}.")
    return value


def _tables(given: Mapping, key: str, where: str) -> list[dict]:
    value = given.get(key, [])
    if not isinstance(value, list) or len(value) > _MAX_ITEMS or not all(isinstance(v, dict) for v in value):
        raise ValueError(f"{where}: [[{key}]] must be at most {_MAX_ITEMS} tables; got {shown(value)}.")
    return value


def _number(value, what: str) -> float:
    if type(value) not in (int, float) or not abs(value) <= MAX_NUMBER:
        raise ValueError(f"{what} must be a number, at most {MAX_NUMBER:g}; got {shown(value)}.")
    return float(value)


# --- parameters -------------------------------------------------------------------------------------------------------


def _parameter(name: str, given, where: str) -> Parameter:
    where = f"{where}: [parameters] {name[:60]}"
    if name in parameters.FRAME:
        raise ValueError(f"{where}: the frame has its own switch. Write frame = true above the first table.")
    if not re.fullmatch(r"[A-Za-z]\w{0,63}", name, re.ASCII) or keyword.iskeyword(name):
        raise ValueError(f'{where}: a name has letters, digits and "_", and is no word of Python. Choose another.')
    if name in _TAKEN or name.startswith("norm_"):
        raise ValueError(f"{where}: this name is taken, it means something else. Choose another.")
    standard = _STANDARD.get(name)
    if given is True and standard:
        return standard
    if not isinstance(given, dict):
        raise ValueError(
            f"{where}: must be a table such as {{ low = 0, high = 1, initial = 0.5 }}, or true for one of the "
            f"package's own: {', '.join(_STANDARD)}; got {shown(given)}."
        )
    _only(given, ("size", "low", "high", "initial", "log"), where)
    base = dataclasses.asdict(standard) if standard else {"size": 1, "log": False}
    values = {**base, **given}
    if missing := [key for key in ("low", "high", "initial") if key not in values]:
        raise ValueError(f"{where}: {', '.join(missing)} is missing. Give low, high and initial.")
    low, high, initial = (_number(values[key], f"{where}: {key}") for key in ("low", "high", "initial"))
    size, log = values["size"], _get(values, "log", bool, where)
    if type(size) is not int or size not in (1, 3):
        raise ValueError(f"{where}: size must be 1, or 3 for a linear RGB colour; got {shown(size)}.")
    if not low <= initial <= high or low == high or (log and low <= 0):
        rule = "0 < low <= initial <= high" if log else "low <= initial <= high"
        raise ValueError(f"{where}: needs {rule} and low < high; got {low:g}, {initial:g}, {high:g}.")
    if standard and ((size, log) != (standard.size, standard.log) or low < standard.low or high > standard.high):
        raise ValueError(
            f"{where}: has size {standard.size}, log {str(standard.log).lower()} and a range within [{standard.low:g}, "
            f"{standard.high:g}] in all models. Narrow the range, or choose another name."
        )
    return Parameter(name, size, low, high, initial, log, kind="colour" if size == 3 else "scalar")


def _start(given: Mapping, all_parameters, where: str) -> dict:
    values = {key: _number(v, f"{where}: {key[:60]}") for key, v in given.items()}
    parameters.check(all_parameters, {**parameters.initial(all_parameters), **values}, where)
    return values


# --- terms and formula ------------------------------------------------------------------------------------------------


def _check_terms(terms: Mapping[str, Expression], kinds: Mapping[str, str], where: str) -> None:
    readers = {name: [slot for slot, term in terms.items() if name in term.reads] for name in kinds}
    for name, slots in readers.items():
        if not slots:
            raise ValueError(f"{where}: no term reads the parameter {name}. Use it, or leave it out.")
        if kinds[name] == "colour" and len(slots) > 1:
            raise ValueError(
                f"{where}: the terms {' and '.join(slots)} both read the colour {name}. Let one term read it, and put "
                "what it multiplies in parentheses in the formula."
            )
    if readers.get("rho_d") != ["M"]:
        raise ValueError(
            f"{where}: the term M must be the diffuse one and read rho_d, the diffuse albedo: sampling and editing "
            'rely on it. Write M = "rho_d / pi" in [terms] and rho_d = true in [parameters].'
        )
    if any((lobe.alpha_x in kinds) != (lobe.alpha_y in kinds) for lobe in LOBES):
        raise ValueError(f"{where}: alpha_x and alpha_y come in pairs. Use both, or another name for one roughness.")
    for slot, term in terms.items():
        both = [name for name in term.reads if name in QUANTITIES]
        if term.is_colour and both:
            raise ValueError(
                f"{where}: [terms] {slot} reads a colour and the direction {both[0]}. Split it: a term of the colour "
                "alone, times a term of the directions."
            )


def _graph(formula: str, terms: Mapping[str, Expression], where: str) -> Node:
    """Turn the formula into a graph; products associate to the right, sums to the left, as in the package's models."""
    tokens = re.findall(r"(?:1/)?[A-Za-z]\w*|\S", formula, re.ASCII)
    names = [t for t in tokens if t not in "+*()"]
    for name in (*names, *terms):
        if names.count(name) != 1 or name not in terms:
            what = "is not in [terms]" if name not in terms else f"stands {names.count(name)} times in the formula"
            raise ValueError(
                f'{where}: the term "{name[:60]}" {what}. Join every term of [terms] once, with "+", "*", parentheses.'
            )

    def unexpected():
        got = f'"{tokens[0]}"' if tokens else "the end"
        return ValueError(f'{where}: {got} comes where it should not in "{formula[:80]}". Check "+", "*", parentheses.')

    def factor(depth: int) -> Node:
        if not tokens or tokens[0] in "+*)" or depth > _MAX_DEPTH:
            raise unexpected()
        first = tokens.pop(0)
        if first != "(":
            return Node(first, terms[first], inputs=terms[first].reads)
        node = total(depth + 1)
        if not tokens or tokens.pop(0) != ")":
            raise unexpected()
        return node

    def product(depth: int) -> Node:
        node = factor(depth)
        if tokens[:1] != ["*"]:
            return node
        tokens.pop(0)
        return node * product(depth)

    def total(depth: int) -> Node:
        node = product(depth)
        while tokens[:1] == ["+"]:
            tokens.pop(0)
            node = node + product(depth)
        return node

    graph = total(0)
    if tokens:
        raise unexpected()
    return graph


def _check_linear(node: Node, terms: Mapping[str, Expression], where: str) -> bool:
    """Tell whether `node` is proportional to a colour; that of the formula is, since M is one of its terms."""
    if not node.args:
        return terms[node.name].is_colour
    a, b = (_check_linear(arg, terms, where) for arg in node.args)
    if node.symbol == "+" and a != b:
        raise ValueError(f"{where}: {node} adds a colour and a number. Let every summand have a factor with a colour.")
    if node.symbol == "*" and a and b:
        raise ValueError(f"{where}: {node} multiplies two colours. f must stay linear in the colours: keep one.")
    return a or b


# --- sampling ---------------------------------------------------------------------------------------------------------


def _lobe(given: Mapping, kinds: Mapping[str, str], where: str) -> list[Expression]:
    _only(given, OWN, where)
    lobe = [expression.parse(given.get(key, ""), kinds, f"{where} {key}") for key in OWN]
    if [e.is_colour for e in lobe] != [True, False, False]:
        raise ValueError(f"{where}: rho_s must be a colour times numbers, alpha_x and alpha_y numbers.")
    return lobe


def _lobes(lobes: list[list[Expression]]):
    return lambda params: [
        (rho_s(**params), *(dr.clip(a(**params), *parameters.ROUGHNESS) for a in alphas)) for rho_s, *alphas in lobes
    ]
