"""Settings of a training."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

from ..neural import mlp
from ..neural.inputs import INPUTS, InputKind
from ..system.settings import FLAG, LIST, TEXT, Rule, Settings, number, of_type, one_of, setting, whole

_REPLACE = of_type("a list of slots, or {slot: hidden sizes}", list, tuple, dict)


@dataclasses.dataclass(frozen=True)
class TrainingSettings(Settings):
    """Settings of :func:`mi_enhance.training.train.train`. ``config.json`` holds them under the same names.

    Parameters
    ----------
    model : str
        Name of the analytic model, or a ``.toml`` file of one.
    replace : list of str, or dict of str to list of int
        Slots that get a module, or slots with the hidden sizes of their modules.
    inputs : str
        What the modules see, see :mod:`mi_enhance.neural.inputs`.
    read_out : str or None
        ``"rgb"`` or ``"scalar"``: the slots share one trunk of the sizes `hidden`, which materials read out by weights
        of their own; None: every slot has a module.
    modulated : bool
        The last layer of a module belongs to the material.
    n_latent : int
        Latent numbers of a material.
    hidden : list of int
        Hidden sizes of the modules, where `replace` names none.
    data, validation : list of dict
        Sources of the materials to train on, and to judge by, see :mod:`mi_enhance.training.sources`.
    n_samples, batch : int
        Samples per material: all, and those of one step.
    steps, imitation_steps : int
        Steps of the training, and of the imitation before it.
    lr, lr_parameters, lr_read_out : float
        Learning rates of the weights, of the parameters and of the read-outs; all fall to 1 % along a cosine.
    refits : int
        Times, evenly spread, that every material is fitted anew.
    seed : int

    Examples
    --------
    >>> TrainingSettings.of({"model": "ward", "replace": ["D"]}).inputs
    'shape'
    """

    WHERE: ClassVar[str] = "train()"

    model: str = setting("ggx", TEXT)
    replace: Any = setting(["F", "F*G", "G", "1/E"], _REPLACE)
    inputs: InputKind = setting("shape", one_of(*INPUTS))
    read_out: Any = setting(None, Rule('"rgb", "scalar" or null', lambda v: v in (None, "rgb", "scalar")))
    modulated: bool = setting(False, FLAG)
    n_latent: int = setting(27, whole())
    hidden: list[int] = setting(list(mlp.HIDDEN), LIST)
    data: list[dict] = setting([], LIST)
    validation: list[dict] = setting([], LIST)
    n_samples: int = setting(8192, whole(1))
    batch: int = setting(64, whole(1))
    steps: int = setting(10000, whole())
    imitation_steps: int = setting(1000, whole())
    lr: float = setting(2e-3, number())
    lr_parameters: float = setting(3e-3, number())
    lr_read_out: float = setting(1e-2, number())
    refits: int = setting(3, whole())
    seed: int = setting(0, whole())
