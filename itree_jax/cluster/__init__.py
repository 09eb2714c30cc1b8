"""Work in units, on this machine or on a Ray cluster: nothing that is done is lost, and both give the same bytes.

| name | what it is |
|---|---|
| `Unit`, `Product`, `Failed` | a piece of work, what comes out of it, why nothing does |
| `Workers`, `ThisMachine`, `workers_at` | who does it: this process, or Ray's (extra `cluster`) |
| `run_units`, `Ran` | does what a folder does not hold yet, and keeps every result as it comes |
| `check_failures` | the error that names what failed |
| `key_of`, `digest_of_file`, `digest_of_listing` | what tells whether a result is still that of its inputs |
"""

from itree_jax.cluster.keys import digest_of_file as digest_of_file
from itree_jax.cluster.keys import digest_of_listing as digest_of_listing
from itree_jax.cluster.keys import key_of as key_of
from itree_jax.cluster.run import Ran as Ran
from itree_jax.cluster.run import check_failures as check_failures
from itree_jax.cluster.run import run_units as run_units
from itree_jax.cluster.unit import Failed as Failed
from itree_jax.cluster.unit import Product as Product
from itree_jax.cluster.unit import Unit as Unit
from itree_jax.cluster.workers import ThisMachine as ThisMachine
from itree_jax.cluster.workers import Workers as Workers
from itree_jax.cluster.workers import workers_at as workers_at
