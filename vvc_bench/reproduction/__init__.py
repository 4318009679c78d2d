"""The paper's tables made again: what each row takes, run and judged beside the paper's figures."""
