// Numbers as text, in one place: no page shows a negative zero.

/** With `digits` after the point; -0.001 with two is "0.00". */
export function fixed(value: number, digits = 0): string {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}
