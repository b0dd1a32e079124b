"""The products of the virtual device by name."""

from __future__ import annotations

from rig.simulated.product.capabilities import CDAQ_9189, PCIE_6363
from rig.simulated.product.older_cards import PCI_6034E, PCI_6602, PCI_6733

PRODUCTS = {product.name: product for product in (CDAQ_9189, PCIE_6363, PCI_6034E, PCI_6602, PCI_6733)}
