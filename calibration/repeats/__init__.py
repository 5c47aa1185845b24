"""What repeats say of noise: sizes of the error model, pure error, presses that stand out."""
