"""Free flights of bats that a network and two people digitised: who comes nearest to the people?"""
