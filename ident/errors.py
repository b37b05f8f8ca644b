"""What can go wrong, and the exit code that the command line gives it.

Every message is one line that holds what was found, the value needed, and what to do next.
"""

from __future__ import annotations


class IdentError(Exception):
    """An error whose cause is known; its message is shown to the user as one line."""

    exit_code = 1

    @property
    def lines(self) -> list[str]:
        """What is shown to the user."""
        return [str(self)]


class UsageError(IdentError):
    """The command was called in a way that has no meaning."""

    exit_code = 2


class UnusableLog(IdentError):
    """No log was found, or none of those given can be read."""

    exit_code = 3


class BadRecipe(IdentError):
    """A recipe, channel map or vehicle file is wrong: a key, a value, a unit."""

    exit_code = 3


class NotIdentifiable(IdentError):
    """The data cannot answer what was asked."""

    exit_code = 4


class RequirementNotMet(IdentError):
    """Requirements of the recipe are not met: each argument is one of them."""

    exit_code = 5

    @property
    def lines(self) -> list[str]:
        """One line for each requirement."""
        return [str(argument) for argument in self.args]
