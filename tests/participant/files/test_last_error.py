"""What is quoted of a program that has ended: the cause, in the words of its language."""

import pytest

from stepbus_participant import last_error

OUTPUTS = {
    "python": (
        (
            'Traceback (most recent call last):\n  File "/a.py", line 4, in f\n    1/0\n    ~^~\n'
            "ZeroDivisionError: division by zero\n\nDuring handling of the above exception, another "
            "exception occurred:\n\nTraceback (most recent call last):\n"
            '  File "/a.py", line 6, in <module>\n    f()\n'
            "RuntimeError: no torque\nsecond line, an error too\nan error of no interest at the exit\n"
        ),
        "RuntimeError: no torque",
    ),
    "python's parser": (
        "  File \"/error.py\", line 1\n    x = (\n        ^\nSyntaxError: '(' was never closed\n",
        "SyntaxError: '(' was never closed",
    ),
    "perl, a missing module": (
        (
            "Can't locate Motor.pm in @INC (you may need to install the Motor module) (@INC contains: "
            "/etc/perl) at a.pl line 1.\nBEGIN failed--compilation aborted at a.pl line 1.\n"
        ),
        (
            "Can't locate Motor.pm in @INC (you may need to install the Motor module) (@INC contains: "
            "/etc/perl) at a.pl line 1."
        ),
    ),
    "perl, its syntax": (
        (
            'syntax error at c.pl line 1, near "= ;"\n'
            "Execution of c.pl aborted due to compilation errors.\n"
        ),
        'syntax error at c.pl line 1, near "= ;"',
    ),
    "perl, confess": (
        "the motor is on fire at b.pl line 1.\n\tmain::error(1) called at b.pl line 1\n",
        "the motor is on fire at b.pl line 1.",
    ),
    "perl, whose stdout comes last": (
        "no torque at d.pl line 1.\nstarting, 0 errors\n",
        "no torque at d.pl line 1.",
    ),
    "lua": (
        (
            "/usr/bin/lua: controller.lua:40: attempt to index a nil value (field 'kpp')\n"
            "stack traceback:\n\tcontroller.lua:40: in upvalue 'update'\n"
            "\tcontroller.lua:52: in main chunk\n\t[C]: in ?\n"
        ),
        "/usr/bin/lua: controller.lua:40: attempt to index a nil value (field 'kpp')",
    ),
    "lua, a call of error": (
        "lua5.4: a.lua:1: no torque\nstack traceback:\n\t[C]: in function 'error'\n\t[C]: in ?\n",
        "lua5.4: a.lua:1: no torque",
    ),
    "octave": (
        (
            "error: 'undefined_thing' undefined near line 2, column 7\nerror: called from\n"
            "    a at line 2 column 5\n"
            "error: ignoring const execution_exception& while preparing to exit\n"
        ),
        "error: 'undefined_thing' undefined near line 2, column 7",
    ),
    "node": (
        (
            '/a.js:1\nfunction f() { throw new Error("no torque"); }\n               ^\n\n'
            "Error: no torque\n    at f (/error.js:1:22)\n    at Module._compile "
            "(node:internal/modules/cjs/loader:1521:14)\n\nNode.js v20.20.2"
        ),
        "Error: no torque",
    ),
    "node, a missing file": (
        (
            "node:internal/modules/cjs/loader:1210\n  throw err;\n  ^\n\n"
            "Error: Cannot find module './nothing'\nRequire stack:\n- /b.js\n"
            "    at Module.require (node:internal/modules/cjs/loader:1289:19) {\n"
            "  code: 'MODULE_NOT_FOUND',\n  requireStack: [ '/b.js' ]\n}\n\nNode.js v20.20.2\n"
        ),
        "Error: Cannot find module './nothing'",
    ),
    "java": (
        (
            'Exception in thread "main" java.lang.RuntimeException: step 3\n\tat A.main(A.java:2)\n'
            "Caused by: java.lang.IllegalStateException: no torque\n\tat A.error(A.java:1)\n"
            "\t... 1 more\n"
        ),
        "Caused by: java.lang.IllegalStateException: no torque",
    ),
    "rust": (
        (
            "\nthread 'main' (25119) panicked at a.rs:1:69:\n"
            'called `Result::unwrap()` on an `Err` value: "no torque"\nstack backtrace:\n'
            "   0: __rustc::rust_begin_unwind\n             at /rustc/std/src/panicking.rs:689:5\n"
            "note: Some details are omitted, run with `RUST_BACKTRACE=full` for a verbose backtrace.\n"
        ),
        (
            "thread 'main' (25119) panicked at a.rs:1:69: "
            'called `Result::unwrap()` on an `Err` value: "no torque"'
        ),
    ),
    "go": (
        (
            "panic: runtime error: index out of range [5] with length 0\n\ngoroutine 1 [running]:\n"
            "main.main()\n\t/error.go:2 +0x9\nexit status 2\n"
        ),
        "panic: runtime error: index out of range [5] with length 0",
    ),
    "c++": (
        (
            "terminate called after throwing an instance of 'std::runtime_error'\n"
            "  what():  no torque\n"
        ),
        "terminate called after throwing an instance of 'std::runtime_error' what():  no torque",
    ),
    "an assertion": (
        "an error, but not the last one\nbc: b.cpp:2: int main(): Assertion `1 == 2' failed.\n",
        "bc: b.cpp:2: int main(): Assertion `1 == 2' failed.",
    ),
    "a shell": ("sh: 1: nosuchcmd: not found\n", "sh: 1: nosuchcmd: not found"),
    "no error at all": ("one\ntwo\n\n", "two"),
    "nothing": ("", ""),
    "nothing but noise": ("pybullet build time: Jan 29 2025\n", ""),
}


@pytest.mark.parametrize(("output", "cause"), OUTPUTS.values(), ids=OUTPUTS)
def test_the_cause_is_quoted(tmp_path, output, cause):
    (tmp_path / "log").write_text(output)
    assert last_error(tmp_path / "log") == cause


def test_a_log_that_is_not_there_quotes_nothing(tmp_path):
    assert last_error(tmp_path / "log") == ""


def test_a_long_line_is_cut(tmp_path):
    (tmp_path / "log").write_text("y" * 1_000_000)
    assert last_error(tmp_path / "log") == "y" * 300
