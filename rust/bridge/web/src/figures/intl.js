// What the charting library asks of a browser for numbers, in an engine that has no Intl. It comes first in the bundle.
globalThis.Intl ??= {
  NumberFormat: class {
    format(number) {
      return String(Number(Number(number).toPrecision(12)));
    }
  },
  DateTimeFormat: class {
    format(date) {
      return String(date);
    }
  },
};
