"""`python -m tumblecal.cli`."""

from tumblecal.cli import main


main()
