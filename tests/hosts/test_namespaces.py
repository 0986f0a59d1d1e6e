"""Participants on hosts of their own, in network namespaces: the same bytes, or a name and an end."""

import signal
import time

import pytest
from support.runs.distant import ENDLESS, LEASE_S, PATIENT, SHORT, Distant

from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

pytestmark = pytest.mark.usefixtures("nothing_is_left")
STEP_S = 3.0
MARGIN_S = 2.0


@pytest.fixture
def local(tmp_path):
    """Return a function: settings → hash of a run on this host only."""

    def hash_of(*settings):
        result = run(load("two_link", [*settings]), Options(out=tmp_path / "local"))
        assert result.exit_code == 0, result.reason
        return result.messages_sha256

    return hash_of


def assert_same(distant, expected):
    result = distant.result()
    assert (result["exit_code"], result["messages_sha256"]) == (0, expected), distant.said()
    distant.within(10, since=time.monotonic())
    assert {p.wait(0) for p in distant.processes.values()} == {0}, distant.said()


def struck(distant, strike):
    """Have something happen in the midst of a run; return when, and what the run says of itself."""
    distant.join().under_way()
    since = time.monotonic()
    strike()
    result = distant.result()
    result["after_s"] = time.monotonic() - since
    return since, result


def assert_ends(distant, strike, code, who, *, but=()):
    """Fail unless the run ends in time with a name, and with it all on all hosts. but: hosts."""
    since, result = struck(distant, strike)
    assert (result["exit_code"], result["participant"]) == (code, who), distant.said()
    assert result["after_s"] < LEASE_S + MARGIN_S, distant.said()
    return distant.within(LEASE_S + MARGIN_S, since=since, but=but), result


def test_three_hosts_give_the_bytes_of_one(tmp_path, wan, local):
    distant = Distant(tmp_path, wan(4), *SHORT).join()
    assert_same(distant, local(*SHORT))
    assert f"listening: {distant.wan.addresses[0]}:" in distant.terminal.read_text()


@pytest.mark.slow
def test_a_slow_network_that_loses_packets_changes_no_byte(tmp_path, wan, local):
    network = wan(4)
    network.shape(delay_s=0.010, jitter_s=0.0025, loss=0.01)
    distant = Distant(tmp_path, network, *SHORT, *PATIENT).join()
    assert_same(distant, local(*SHORT))
    assert network.counts()["lost"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("hosts", [(1,), (2,), (0,), (1, 2, 3)], ids=str)
def test_a_link_that_is_down_for_5_s_changes_no_byte(tmp_path, wan, local, hosts):
    network = wan(4)
    network.shape(delay_s=0.010)
    distant = Distant(tmp_path, network, "duration=2s", *PATIENT).join()
    distant.under_way(8_000)
    network.cut(*hosts)
    time.sleep(5)
    assert not distant.has_ended(), distant.said()
    network.cut()
    assert_same(distant, local("duration=2s"))


@pytest.mark.slow
@pytest.mark.parametrize("who", ["plant", "controller", "mission"])
def test_who_is_killed_is_named_and_all_hosts_end(tmp_path, wan, who):
    distant = Distant(tmp_path, wan(4), *ENDLESS)
    _, result = assert_ends(distant, lambda: distant.kill(who), ExitCode.DIED, who)
    assert result["after_s"] < STEP_S + MARGIN_S


@pytest.mark.slow
@pytest.mark.parametrize("who", ["plant", "controller", "mission"])
def test_a_host_that_dies_is_named_and_all_hosts_end(tmp_path, wan, who):
    distant = Distant(tmp_path, wan(4), *ENDLESS)
    host = distant.hosts[who]
    _, result = assert_ends(distant, lambda: distant.wan.cut(host), ExitCode.STEP_TIMEOUT, who)
    assert f"{distant.wan.addresses[host]} has not answered for" in result["reason"]


@pytest.mark.slow
def test_a_host_that_dies_is_named_after_the_lease_where_a_step_may_take_longer(tmp_path, wan):
    distant = Distant(tmp_path, wan(4), *ENDLESS, *PATIENT)
    host = distant.hosts["controller"]
    _, result = assert_ends(distant, lambda: distant.wan.cut(host), ExitCode.DIED, "controller")
    assert f"{distant.wan.addresses[host]} has not answered for" in result["reason"]


@pytest.mark.slow
def test_who_is_frozen_is_named(tmp_path, wan):
    distant = Distant(tmp_path, wan(4), *ENDLESS)
    host = distant.hosts["plant"]
    freeze = lambda: distant.kill("plant", signal.SIGSTOP)  # noqa: E731
    assert_ends(distant, freeze, ExitCode.STEP_TIMEOUT, "plant", but=(host,))
    # It is not ours; it ends by itself once it continues.
    distant.kill("plant", signal.SIGCONT)
    distant.within(LEASE_S + MARGIN_S, since=time.monotonic())


@pytest.mark.slow
def test_a_killed_orchestrator_leaves_nothing_on_any_host(tmp_path, wan):
    distant = Distant(tmp_path, wan(4), *ENDLESS).join()
    distant.under_way()
    since = time.monotonic()
    distant.orchestrator.kill()
    distant.within(LEASE_S + MARGIN_S, since=since)
    assert {one.wait(0) for one in distant.processes.values()} == {1}, distant.said()


@pytest.mark.slow
def test_an_orchestrator_whose_network_is_gone_leaves_nothing_on_any_host(tmp_path, wan):
    distant = Distant(tmp_path, wan(4), *ENDLESS).join()
    distant.under_way()
    since = time.monotonic()
    distant.wan.cut(0)
    distant.within(LEASE_S + MARGIN_S, since=since)
    assert distant.result()["exit_code"] == ExitCode.STEP_TIMEOUT
