"""Compiled kernels are never stale."""

import subprocess
import sys
from pathlib import Path

CALLEE = "from models.compiled import compiled\n\n@compiled\ndef inner(x):\n    return x + {}\n"
CALLER = (
    "from callee import inner\nfrom models.compiled import compiled\n\n@compiled\ndef outer(x):\n    return inner(x)\n"
)


def _run(folder: Path) -> str:
    code = "from caller import outer; print(outer(1.0), sum(outer.stats.cache_hits.values()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_kernel_is_compiled_anew_when_a_kernel_it_calls_in_another_file_changes(tmp_path):
    (tmp_path / "callee.py").write_text(CALLEE.format(1.0))
    (tmp_path / "caller.py").write_text(CALLER)
    assert _run(tmp_path) == "2.0 0"
    assert _run(tmp_path) == "2.0 1"
    (tmp_path / "callee.py").write_text(CALLEE.format(5.0))
    assert _run(tmp_path) == "6.0 0"
