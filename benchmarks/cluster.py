"""A Dask scheduler and workers on this machine, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]


class Cluster:
    """Lives in `folder` until it is stopped."""

    def __init__(self, folder: Path, workers: int = 0) -> None:
        self.folder, self.file = folder, folder / "scheduler.json"
        self.workers: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._process("dask_scheduler", "--port", "0", "--host", "127.0.0.1")
        end = time.monotonic() + 60.0
        while not (self.file.exists() and self.file.read_text().rstrip().endswith("}")):  # and is written whole
            if time.monotonic() > end:
                self.stop()
                raise TimeoutError("the scheduler does not start")
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]
        for _ in range(workers):
            self.add_worker()

    def add_worker(self) -> None:
        """One more worker of one thread, which nobody starts again where it dies."""
        self.workers.append(self._process("dask_worker", "--no-nanny", "--nthreads", "1", "--memory-limit", "0"))

    def stop(self) -> None:
        """Ends all processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _process(self, name: str, *arguments: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{name}", "--scheduler-file", str(self.file), "--no-dashboard",
             *arguments],
            cwd=self.folder, env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
