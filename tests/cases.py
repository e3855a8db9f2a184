"""Cases of a test that take a moment each: one test asks them all."""

import inspect
from functools import wraps

import pytest


def each_of(names, cases):
    """Call a test for each case, with arguments as `pytest.mark.parametrize` gives them.

    All cases are tried.  Errors name the case in a note, several are raised together.
    """
    own = (names,) if isinstance(names, str) else names
    given = [dict(zip(own, (c,) if names is own[0] else c, strict=True)) for c in cases]
    assert given, "no cases"

    def decorate(test):
        @wraps(test)
        def every(**fixtures):
            errors, skips = [], []
            for case in given:
                try:
                    test(**case, **fixtures)
                except pytest.skip.Exception as skipped:
                    skips.append(skipped)
                except (Exception, BaseExceptionGroup, pytest.fail.Exception) as error:
                    error.add_note(f"case: {case}")
                    errors.append(error)
            errors = errors or skips[:1]  # a case that is skipped hides none that fails
            if errors:
                raise errors[0] if len(errors) == 1 else BaseExceptionGroup("cases", errors)

        signature = inspect.signature(test)
        kept = [one for name, one in signature.parameters.items() if name not in own]
        every.__signature__ = signature.replace(parameters=kept)
        return every

    return decorate
