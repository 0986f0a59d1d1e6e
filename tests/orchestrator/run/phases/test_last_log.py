"""The last log of a participant is not lost where a session that closes drops what it holds."""

import pytest

import stepbus

THROUGH_THE_BUS = {"unix": 1, "tcp": 2}
"""How often each participant says hello: only the low-latency transport drops nothing (P11.4)."""


class Hellos(stepbus.RunExtension):
    def attach(self, run):
        super().attach(run)
        self.names, take = [], run.messages.take_join

        def counted(data, reply):
            take(data, lambda answer: (self.names.append(answer.name), reply(answer)))

        run.messages.take_join = counted


@pytest.mark.slow
@pytest.mark.parametrize(("transport", "times"), THROUGH_THE_BUS.items())
def test_a_participant_asks_whether_all_is_out(tmp_path, transport, times):
    hellos = Hellos()
    overrides = {"duration": "10ms", "bus.transport": transport}
    result = stepbus.run("two_link", set=overrides, out=tmp_path / "run", extensions=[hellos])
    assert result.exit_code == 0
    assert sorted(hellos.names) == sorted(["controller", "mission", "plant"] * times)
