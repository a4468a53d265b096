"""Each kernel of a multigrid iteration against the memory: bytes counted as each input once and each output once.

`python -m bench.roofline [--full] [--device cuda:0] [--sizes sphere:9]`
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp

import oneform_warp as ow
from bench.iteration import replayed
from bench.launches import Launch, recorded
from bench.options import Options, options
from bench.problem import Case, Problem
from bench.table import calm, report


@wp.kernel(enable_backward=False)
def _copied(
    # In:
    source: wp.array[wp.float64],
    # Out:
    target_out: wp.array[wp.float64],
):
    i = wp.tid()
    target_out[i] = source[i]


def copy_bandwidth(device: Any) -> float:
    """Bytes a second of a large copy, read plus written: by the driver or by a kernel, whichever is faster."""
    count = 200_000_000 if device.is_cuda else 25_000_000
    source, target = (wp.zeros(count, dtype=wp.float64, device=device) for _ in range(2))
    by_driver = replayed(lambda: wp.copy(target, source), device)
    by_kernel = replayed(
        lambda: wp.launch(_copied, dim=count, inputs=[source], outputs=[target], device=device), device
    )
    return 2.0 * 8.0 * count / min(by_driver, by_kernel)


def measured(what: str, launches: list[Launch], work: Callable[[], None], bandwidth: float, device: Any) -> dict:
    """One row: `work` does the launches listed."""
    calm()
    seconds, moved = replayed(work, device), sum(launch.bytes for launch in launches)
    return {
        "what": what,
        "rows": launches[0].size,
        "launches": len(launches),
        "MB": moved / 1e6,
        "us": 1e6 * seconds,
        "GB/s": moved / seconds / 1e9,
        "of copy": moved / seconds / bandwidth,
    }


def again(launches: list[Launch]) -> Callable[[], None]:
    def work() -> None:
        for launch in launches:
            launch.again()

    return work


def rows_of(name: str, bandwidth: float, device: Any) -> list[dict[str, Any]]:
    """The finest level's kernels, then all other launches of a cycle, the cycle and the whole iteration."""
    problem = Problem.of(Case(name), device)
    solver = ow.Multigrid()
    state = solver.prepare(problem.graph, problem.pinned)
    solver.solve(state, problem.v, problem.start)
    inner = state.inner
    launches, cycle = recorded(inner._iterate), recorded(inner.cycle.run)

    def line(what: str, some: list[Launch], work: Callable[[], None] | None = None) -> dict[str, Any]:
        return {"mesh": name, **measured(what, some, work or again(some), bandwidth, device)}

    count = problem.graph.node_count
    finest = {launch.kernel: launch for launch in launches if launch.size >= count}
    restrict = next((k for k in launches if k.kernel == "restrict"), None)
    if restrict is not None:
        finest["restrict"] = restrict  # its rows are those of the next level
    rows = [line(kernel, [launch]) for kernel, launch in finest.items()]
    coarse = [launch for launch in cycle if launch.size < count and launch is not restrict]
    if coarse:
        rows.append(line("all coarser levels", coarse))
    rows.append(line("cycle", cycle, inner.cycle.run))
    rows.append(line("iteration", launches, inner._iterate))
    return rows


def main(given: Options) -> None:
    device = given.device
    sizes = ["sphere:8", "sphere:9"] if device.is_cuda else ["sphere:6"]
    if given.full:
        sizes += ["sphere:10"] if device.is_cuda else ["sphere:8"]
    bandwidth = copy_bandwidth(device)
    rows = [row for name in given.sizes or sizes for row in rows_of(name, bandwidth, device)]
    claim = f"a multigrid iteration against a copy at {bandwidth / 1e9:.0f} GB/s, on {device.name}"
    report(f"roofline-{'cuda' if device.is_cuda else 'cpu'}", claim, rows)


if __name__ == "__main__":
    main(options())
