"""Scalars that are computed alike become one vector: for languages in which an operation on many numbers costs as one.

Sums of products with the same factors are the rows of a matrix; what is done to all lanes of a vector alike is done to
the vector. So the layers of a network come out as matrix products again, whatever the code was that computed them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from .recorder import Recorder, Value, in_order

_SHORTEST = 3  # products in a sum that is made a row of a matrix

Lanes = tuple[Value, ...]


class Vectorizer:
    """Rewrites values of a function.

    New operations: ``lane`` (a vector, its index), ``pick`` (a vector, indices), ``rows`` (scalars and vectors, one
    after the other), ``column`` (a vector of numbers), ``array`` (numbers), ``linear`` (the weights as an array or a
    vector, how many rows they have, the vector of factors, what is added).

    Parameters
    ----------
    outputs : sequence of Value
    vectors : dict of str to sequence of Value
        The vectors that the function is given.
    labels : dict of Value to str
        Names of values; :attr:`labels` has those of the new ones.
    """

    def __init__(self, outputs: Sequence[Value], vectors: Mapping[str, Sequence[Value]], labels: Mapping[Value, str]):
        self._recorder, self._old_labels = Recorder(), labels
        self.labels: dict[Value, str] = {}
        given = {v.number for lanes in vectors.values() for v in lanes}
        self._values = in_order(outputs, lambda v: v.number in given)
        self._users: dict[int, list[Value]] = defaultdict(list)
        for v in self._values:
            if v.number not in given:
                for number in {a.number for a in v.args if isinstance(a, Value)}:
                    self._users[number].append(v)
        self._packs: dict[int, tuple[Lanes, int]] = {}  # of a value: the pack it is in, and its lane
        self._sums: dict[Lanes, tuple[list[Lanes], Lanes, Lanes]] = {}  # of a pack: weights of each row, factors, rest
        self._new: dict[object, Value] = {}
        for name, lanes in vectors.items():
            if lanes:
                self._pack(tuple(lanes))
                self._new[tuple(v.number for v in lanes)] = self._make("input", name)
        self._find_sums(given)
        for lanes in list(self._lanes_of_packs()):
            self._grow(lanes)

    def _make(self, op: str, *args) -> Value:
        return self._recorder.make(op, args, "float", True)

    # ------------------------------------------------------------------ finding

    def _pack(self, lanes: Lanes) -> None:
        for k, v in enumerate(lanes):
            self._packs[v.number] = lanes, k

    def _lanes_of_packs(self) -> Iterable[Lanes]:
        return {id(lanes): lanes for lanes, _ in self._packs.values()}.values()

    def _find_sums(self, given: set[int]) -> None:
        """Make the sums of products with the same factors a pack."""
        found: dict[tuple, list[tuple[Value, Lanes, Lanes, Value]]] = defaultdict(list)
        for v in self._values:
            if v.op != "fma" or v.number in given or v.number in self._packs or self._is_link(v):
                continue
            links, rest = [v.args[:2]], v.args[2]
            while rest.op == "fma" and rest.number not in given and self._is_link(rest):
                links.append(rest.args[:2])
                rest = rest.args[2]
            factors, weights = zip(*reversed(links), strict=True)
            constant = {w.op == "constant" for w in weights}
            if len(links) >= _SHORTEST and len(constant) == 1 and (rest.op == "constant" or rest.number in given):
                key = (constant.pop(), *(x.number for x in factors))
                found[key].append((v, weights, factors, rest))
        for rows in found.values():
            rows.sort(key=lambda row: row[0].number)
            lanes = tuple(v for v, *_ in rows)
            self._pack(lanes)
            self._sums[lanes] = [weights for _, weights, *_ in rows], rows[0][2], tuple(r for *_, r in rows)

    def _is_link(self, v: Value) -> bool:
        users = self._users[v.number]
        return len(users) == 1 and users[0].op == "fma" and users[0].args[2].number == v.number

    def _grow(self, lanes: Lanes) -> None:
        """Make packs of what is done to all lanes alike, and of what is done to those."""
        if len(lanes) < 2:
            return
        for user in self._users[lanes[0].number]:
            if user.number in self._packs or user.op in ("gather", "fma"):
                continue
            row = [user]
            for k in range(1, len(lanes)):
                alike = (u for u in self._users[lanes[k].number] if self._alike(user, u, k))
                row.append(next(alike, user))
            if len({v.number for v in row}) == len(lanes):
                self._pack(tuple(row))
                self._grow(tuple(row))

    def _alike(self, first: Value, v: Value, k: int) -> bool:
        """Tell whether `v` is to lane `k` of some packs what `first` is to their lane 0."""
        if v.op != first.op or v.kind != first.kind or v.number in self._packs or len(v.args) != len(first.args):
            return False
        for a, b in zip(first.args, v.args, strict=True):
            pack_a, pack_b = self._packs.get(a.number), self._packs.get(b.number)
            same_pack = pack_a and pack_b and pack_a[0] is pack_b[0] and pack_a[1] == 0 and pack_b[1] == k
            if a.number != b.number and not same_pack:
                return False
        return True

    # ------------------------------------------------------------------ rewriting

    def scalar(self, v: Value) -> Value:
        """Return a value in terms of the vectors."""
        if v.op == "constant":
            return self._recorder.make(v.op, v.args, v.kind, False)
        key = v.number
        if key not in self._new:
            if key in self._packs:
                lanes, k = self._packs[key]
                alone = lanes in self._sums and len(lanes) == 1  # a sum of its own is no vector
                self._new[key] = self._whole(lanes) if alone else self._make("lane", self._whole(lanes), k)
            else:
                args = tuple(self.scalar(a) if isinstance(a, Value) else a for a in v.args)
                self._new[key] = self._recorder.make(v.op, args, v.kind, True)
                if v in self._old_labels:
                    self.labels[self._new[key]] = self._old_labels[v]
        return self._new[key]

    def joined(self, lanes: Sequence[Value]) -> Value:
        """Return a vector of several values that are computed one by one."""
        return self._make("rows", *self._parts(tuple(lanes)))

    def vector(self, lanes: Lanes) -> Value:
        """Return a vector of several values."""
        if all(v.op == "constant" for v in lanes):
            return self._make("column", _numbers(lanes))
        packs = {id(pack): pack for pack, _ in (self._packs.get(v.number, ((), 0)) for v in lanes)}
        places = [self._packs.get(v.number, ((), 0))[1] for v in lanes]
        (pack, *others) = packs.values()
        if pack and not others and len(pack) > 1:
            whole = self._whole(pack)
            return whole if places == list(range(len(pack))) else self._make("pick", whole, tuple(places))
        return self._make("rows", *self._parts(lanes))

    def _parts(self, lanes: Lanes) -> list[Value]:
        """Return scalars, and whole packs where all lanes of one follow one another."""
        parts, k = [], 0
        while k < len(lanes):
            pack, place = self._packs.get(lanes[k].number, ((lanes[k],), 0))
            n = len(pack)
            if n > 1 and [v.number for v in lanes[k : k + n]] == [v.number for v in pack]:
                parts.append(self._whole(pack))
                k += n
            else:
                constant = lanes[k].op == "constant"
                parts.append(self._make("column", _numbers(lanes[k : k + 1])) if constant else self.scalar(lanes[k]))
                k += 1
        return parts

    def _whole(self, lanes: Lanes) -> Value:
        key = tuple(v.number for v in lanes)
        if key not in self._new:
            if lanes in self._sums:
                weights, factors, rest = self._sums[lanes]
                flat = tuple(w for row in weights for w in row)
                constant = flat[0].op == "constant"
                matrix = self._make("array", _numbers(flat)) if constant else self.vector(flat)
                if len(lanes) > 1:
                    self._new[key] = self._make("linear", matrix, len(lanes), self.vector(factors), self.vector(rest))
                else:
                    self._new[key] = self._make("linear", matrix, 1, self.vector(factors), self.scalar(rest[0]))
            else:
                first = lanes[0]
                columns = zip(*(v.args for v in lanes), strict=True)
                args = tuple(
                    self.scalar(column[0]) if len({a.number for a in column}) == 1 else self.vector(column)
                    for column in columns
                )
                self._new[key] = self._recorder.make(first.op, args, first.kind, True)
            stems = {self._old_labels.get(v, "").rpartition("_")[0] for v in lanes}
            if stems != {""} and len(stems) == 1:
                self.labels[self._new[key]] = stems.pop()
        return self._new[key]


def _numbers(constants: Lanes) -> tuple[float, ...]:
    return tuple(v.args[0] for v in constants)
