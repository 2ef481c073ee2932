"""The paper's figures and claims beside what was measured."""
