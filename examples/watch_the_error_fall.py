"""
Watch the error fall in a notebook
==================================

Compare the model with measurements, see where it fails, learn which effect is missing, and add it.
The sample holds presses on a gel that the base model does not describe. Install the extra ``notebook``.
"""

# %%
# Load a recording. A notebook shows each record as a short table.
from pathlib import Path

from tactilevision import calibrate_recording, compare_recordings, diagnose_recording, fit, read_recording

try:
    sample = Path(__file__).parents[1] / "sample_frames" / "hidden_material"
except NameError:  # in a notebook, which is started in the repository
    sample = Path("sample_frames/hidden_material")
recording = read_recording(sample)
recording

# %%
# Fit the base model. The notes say that it does not explain these data.
result = calibrate_recording(recording)
result

# %%
# Compare it with the measured forces. The residual has a pattern.
result.plot_fit()

# %%
# A table has a row a press. These fit worst.
presses = result.to_frame()
presses.nlargest(5, "rms_residual_N")[["press", "indenter", "depth_mm", "force_N", "rms_residual_N"]]

# %%
# Do all punches fail alike?
presses.groupby("indenter")[["depth_mm", "force_N", "rms_residual_N"]].mean()

# %%
# Search for the effect that is missing. The verdict is IDENTIFIED: the gel relaxes under load.
diagnosis = diagnose_recording(recording)
diagnosis

# %%
# The residual of the base model (orange) depends on the time in a press and on unloading; with the effect (blue),
# it does not.
diagnosis.plot_residuals()

# %%
# The sizes of the effect, with 95 % intervals.
for effect in diagnosis.effects:
    for name, size in effect.parameters:
        low, high = size.interval95 or (float("nan"), float("nan"))
        print(f"{name} {size.value:.4f} {size.unit}, {low:.4f} to {high:.4f}")

# %%
# Add the effect by hand. The same works with effects of your own.
comparison = compare_recordings(recording, [effect.key for effect in diagnosis.effects])
comparison

# %%
# The error on held-out presses falls to the repeatability of the presses.
comparison.plot_fall()

# %%
# Young's modulus before and after, with the allowance for what may be unseen.
for words, material in (("before", diagnosis.material.before), ("after", diagnosis.material.after)):
    low, high = material.youngs_modulus.interval95 or (float("nan"), float("nan"))
    print(f"E {words}: {material.youngs_modulus.value:.4f} MPa, {low:.4f} to {high:.4f}")

# %%
# Arrays from elsewhere are fitted by the same model. ``open_workbench(recording)`` shows all of this as a page.
curve = recording.curves[0]
fit(curve.depth_mm, curve.force_N[:, 2], time_s=curve.time_s, radius_mm=2.5, thickness_mm=3.1, nu=0.49)
