"""`--greet NAME` of `msbot master` and `msbot agent`: a greeting when the robot is up."""

import click

from msbot_agent.cli.command_services import CommandService


class Greeting(CommandService):
    options = (click.option("--greet", metavar="NAME", help="Say hello to NAME."),)

    def check(self, given):
        return given["greet"]  # None: it is not wanted

    def coroutines(self, name, context):
        return [self.greet(name, context)]

    async def greet(self, name, context):
        await context.ready.wait()
        context.say(f"Hello, {name}!")


GREETING = Greeting()
