"""Models that a test has changed on purpose: `model.json` is made to name the files as they stand now."""

import hashlib
import json
from pathlib import Path


def sealed(folder: Path) -> Path:
    """The folder, its digests brought up to date, as if the changed files had been derived."""
    path = folder / "model.json"
    content = json.loads(path.read_text())
    for name in content["files_sha256"]:
        if (folder / name).exists():
            content["files_sha256"][name] = hashlib.sha256((folder / name).read_text().encode()).hexdigest()
    path.write_text(json.dumps(content))
    return folder
