"""`python -m tumblecal`: the command, where it is not on the path."""

from tumblecal.cli import main


main()
