"""`make bench`: all benchmarks, as ratios measured side by side in one run."""

import bench_analyze
import bench_map
import bench_node
import bench_tick
from rich.console import Console
from rich.table import Table


def main() -> None:
    table = Table(title="Ratios of one run (times are of this machine, now)")
    for name, justify in (("what", "left"), ("against", "left"), ("ratio", "right")):
        table.add_column(name, justify=justify)
    for module in (bench_tick, bench_node, bench_analyze, bench_map):
        for row in module.run():
            table.add_row(*row)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
