# The benchmark in a container:
#   docker build --tag fpg-bench .
#   docker run --rm fpg-bench                                    # trains PPO and compares it with the scripted allies
#   docker run --rm fpg-bench fpg-bench play --opponent tone     # any other command
FROM python:3.11-slim

RUN useradd --create-home --uid 1000 fpg
WORKDIR /home/fpg/source
COPY pyproject.toml README.md LICENSE constraints.txt ./
COPY fpg_bench fpg_bench
COPY baselines baselines
COPY docs docs

# PyTorch's build for CPUs first: the other one holds gigabytes of CUDA, which small networks do not need.
RUN pip install --no-cache-dir -c constraints.txt torch --index-url https://download.pytorch.org/whl/cpu \
    && pip install --no-cache-dir -c constraints.txt ".[train,video]"

USER 1000
WORKDIR /home/fpg
# Compile the game once, into the user's cache.
RUN fpg-bench play --ally idle --opponent tone --seed 1 --every 300

# As `make benchmark`.
CMD ["sh", "-c", "fpg-bench train ppo-fast FPG/AllyVsScripted-v0 --steps 2000000 --out results/ppo-fast --restart && fpg-bench evaluate all-scripted ally-rule/rule/seed_0 results/ppo-fast/agent --suite ally-v2 --out results/ally-v2"]
