"""``python -m mi_enhance`` is ``mi-enhance``."""

from __future__ import annotations

import sys

from .cli.main import main

sys.exit(main())
