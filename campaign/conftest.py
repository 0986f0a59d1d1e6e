"""Options of the campaign: `make campaign CAMPAIGN='--seed 3 --patience 2.5'`."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that draw the cases."""
    parser.addoption("--seed", type=int, default=1, help="of the cases (default: 1)")
    parser.addoption("--count", type=int, help="number of cases of each part")
    text = (
        "factor for all deadlines of the runs; above 1, only a run that hangs for two minutes is "
        "late, so that a slow machine does not matter"
    )
    parser.addoption("--patience", type=float, default=1.0, help=text)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Draw the cases of a part by its function `cases`."""
    seed, count = (metafunc.config.getoption(name) for name in ("--seed", "--count"))
    rows = metafunc.module.cases(seed, count or metafunc.module.WHOLE)
    metafunc.parametrize("case", rows, ids=str)
