"""2b: toolpath or recorded path + stock + tool -> motion, engagement, forces, removal rate."""
