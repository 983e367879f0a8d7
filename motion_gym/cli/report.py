"""The commands that write the results page and show it."""

from __future__ import annotations

import functools
import http.server
from pathlib import Path
from typing import Annotated

import tyro

from motion_gym.cli.output import progress_bar, reporter, say
from motion_gym.cli.run import FOLDER
from motion_gym.contract import SpecError
from motion_gym.specs import whole_number

Rows = tyro.conf.UseAppendAction
PAGE = Path("motion-gym-results.html")


def report(
    domain: Annotated[list[str], Rows, tyro.conf.arg(metavar="DOMAIN")],
    predictor: Annotated[list[str], Rows, tyro.conf.arg(metavar="PREDICTOR")],
    results: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[RESULTS]")] = None,
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = PAGE,
    scenes: bool = False,
    count: int = 8,
) -> None:
    """Write the results page: one file with the leaderboard, tables, curves, claims and a scene player.

    It is made from stored runs alone, and opens in any browser without a network.

    Args:
        domain: With --scenes, show scenes of this domain in place of the simulated ones; once for each domain.
        predictor: With --domain, the predictors that forecast its scenes; once for each.
        results: Folder of results that `motion-gym run --out` wrote: its rows of your own are shown beside the shipped
            rows. Without it, the shipped rows are shown.
        out: File to write.
        scenes: Compute the forecasts of the scene player, and write them to RESULTS/scenes.json.xz.
        count: Scenes of each --domain.
    """
    from motion_gym.benchmarks.page import page
    from motion_gym.benchmarks.page import scenes as scene_file

    if results is not None and not results.is_dir():
        raise SpecError(f"`{results}` is no folder of results: name one that `motion-gym run NAME --out FOLDER` wrote.")
    if (domain or predictor) and not scenes:
        raise SpecError("`--domain` and `--predictor` choose what is computed for the scene player: add --scenes.")
    if predictor and not domain:
        raise SpecError("`--predictor` needs a `--domain` whose scenes are forecast.")
    if scenes:
        folder = results or FOLDER
        whole_number("count", count, 1, 1000)
        chosen = scene_file.chosen_by_user(domain, predictor, count) if domain else scene_file.SIMULATED
        with progress_bar() as progress:
            content = scene_file.compute(chosen, reporter(progress, "scenes"))
        say(f"Written: {scene_file.write(folder, content)}")
    else:
        content = scene_file.read(results)
    page.write(out, results, content)
    say(f"Written: {out}")
    if results is not None:
        _say_what_is_not_shown(results)


def _say_what_is_not_shown(results: Path) -> None:
    """Name the runs in a folder of results that are of no shipped benchmark."""
    from motion_gym.benchmarks.running import BENCHMARKS

    others = [folder.name for folder in sorted(results.iterdir()) if folder.name not in BENCHMARKS and _runs_in(folder)]
    if others:
        names = ", ".join(f"`{name}`" for name in others)
        say(f"Not shown, as the page has the shipped benchmarks alone: {names}. `motion-gym run` writes their tables.")
    if _runs_in(results) and results.absolute().name in BENCHMARKS:
        say(f"The runs in {results} itself are not shown: name the folder above it, {results.absolute().parent}.")
    elif _runs_in(results):
        say(f"The runs in {results} itself, as of `motion-gym score`, are of no shipped benchmark, and are not shown.")


def _runs_in(folder: Path) -> bool:
    return folder.is_dir() and any(folder.glob("*--*.json"))


def serve(
    page: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = PAGE,
    port: int = 8000,
) -> None:
    """Show a results page to browsers of this machine alone, at http://127.0.0.1:PORT.

    Args:
        page: The page.
        port: Port; 0 for any that is free.
    """
    if not page.is_file():
        raise SpecError(f"There is no page `{page}`: write it with `motion-gym report --out {page}`.")
    whole_number("port", port, 0, 65535)
    handler = functools.partial(_OnePage, page.read_bytes())
    try:
        server = http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
    except OSError as error:
        raise SpecError(f"Port {port} cannot be used: {error.strerror}. Choose another with --port.") from None
    say(f"http://127.0.0.1:{server.server_port}/ shows {page}. Ctrl-C stops it.")
    with server:
        server.serve_forever()


class _OnePage(http.server.BaseHTTPRequestHandler):
    """Serves one page, and nothing else of the folder."""

    def __init__(self, content: bytes, *arguments: object):
        self.content = content
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """Send the page."""
        known = self.path.partition("?")[0] == "/"
        self.send_response(200 if known else 404)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        if known:
            self.wfile.write(self.content)

    def log_message(self, format: str, *arguments: object) -> None:
        """Print nothing for a request."""
