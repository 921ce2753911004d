// The charts of a report. Data: the JSON of #data (chart_data.cpp). One window of time is shown by all
// charts. A chart draws, for each column of pixels, the smallest and the largest value that fall into
// it: of what the page holds, no peak is hidden at any zoom.
'use strict';
(function () {
  const page = JSON.parse(document.getElementById('data').textContent);
  const whole = page.window;
  let shown = whole.slice();
  const charts = [];

  function floats(base64) {
    const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    const values = new Float32Array(bytes.length / 4);
    for (let i = 0; i < values.length; ++i) values[i] = view.getFloat32(4 * i, true);
    return values;
  }

  // Fills in what a series of the page holds, once.
  function load(series) {
    if (series.loaded) return;
    series.loaded = true;
    if (series.kind === 'envelope') {
      series.high = floats(series.high);
      series.low = series.low === undefined ? series.high : floats(series.low);
    }
  }

  // Buckets first .. last - 1 by `merge`, as points: where they hold one sample, that; else the two
  // extremes, the one nearer to the last point first.
  function pushBuckets(points, series, first, last, merge) {
    const step = series.bucket_s;
    let before = NaN;
    for (let i = first; i < last; i += merge) {
      let low = Infinity, high = -Infinity;
      for (let j = i; j < Math.min(i + merge, last); ++j) {
        if (series.low[j] < low) low = series.low[j];
        if (series.high[j] > high) high = series.high[j];
      }
      const time = series.from_s + i * step;
      if (low > high) {
        points.push([time, NaN]);
        continue;
      }
      if (low === high) {
        points.push([time, high]);
      } else {
        const isLowFirst = !(Math.abs(before - high) < Math.abs(before - low));
        points.push([time, isLowFirst ? low : high]);
        points.push([time + merge * step / 2, isLowFirst ? high : low]);
      }
      before = points[points.length - 1][1];
    }
  }

  // The window in full, what lies beside it coarsely: so a drag shows something at once.
  function envelopePoints(series, window, columns) {
    const count = series.high.length;
    const index = (time) => Math.floor((time - series.from_s) / series.bucket_s);
    const first = Math.min(Math.max(index(window[0]) - 1, 0), count);
    const last = Math.min(Math.max(index(window[1]) + 2, first), count);
    const coarse = Math.max(1, Math.ceil(count / 200));
    const points = [];
    pushBuckets(points, series, 0, first, coarse);
    pushBuckets(points, series, first, last, Math.max(1, Math.floor((last - first) / columns)));
    pushBuckets(points, series, last, count, coarse);
    return points;
  }

  function pointsOf(series, window, columns) {
    load(series);
    if (series.kind === 'constant') {
      return [[series.from_s, series.value], [series.until_s, series.value]];
    }
    if (series.kind === 'points') return series.points;
    return envelopePoints(series, window, columns);
  }

  // Series with times of their own as rows of one table; null: the line passes by.
  function rowsOf(chart, window, columns) {
    const lists = chart.series.map((series) => pointsOf(series, window, columns));
    const next = lists.map(() => 0);
    const rows = [];
    for (;;) {
      let time = Infinity;
      lists.forEach((list, k) => {
        if (next[k] < list.length && list[next[k]][0] < time) time = list[next[k]][0];
      });
      if (time === Infinity) return rows;
      const row = [time];
      lists.forEach((list, k) => {
        const isHere = next[k] < list.length && list[next[k]][0] === time;
        row.push(isHere ? list[next[k]][1] : null);
        if (isHere) ++next[k];
      });
      rows.push(row);
    }
  }

  function style(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  function colours(chart) {
    return chart.series.map((series) => style(series.role === 'threshold' ? '--threshold'
      : series.run === 1 ? '--run-b' : '--run-a'));
  }

  // Bands behind the lines: while faults acted, and while the residual fired.
  function drawBands(chart, context, area, dygraph) {
    const paint = (ranges, colour, top, height) => {
      context.fillStyle = colour;
      for (const [from, until] of ranges) {
        const left = Math.max(dygraph.toDomXCoord(from), area.x);
        const right = Math.min(dygraph.toDomXCoord(until), area.x + area.w);
        if (right >= left) context.fillRect(left, top, Math.max(right - left, 1), height);
      }
    };
    paint(chart.faults || page.faults, style('--fault-band'), area.y, area.h);
    (chart.fired || []).forEach((ranges, run) => {
      paint(ranges, style(run === 1 ? '--run-b' : '--fired'), area.y + 5 * run, 4);
    });
  }

  function columnsOf(element) {
    return Math.max(200, Math.round(element.clientWidth));
  }

  function make(element) {
    const chart = page.charts[Number(element.dataset.chart)];
    const options = {
      labels: ['t'].concat(chart.series.map((series) => series.label)),
      colors: colours(chart),
      series: {},
      connectSeparatedPoints: true,
      customBars: chart.has_bands === true,
      dateWindow: shown.slice(),
      labelsDiv: element.parentElement.querySelector('.readout'),
      legend: 'onmouseover',
      strokeWidth: 1.25,
      fillAlpha: 0.2,
      drawPoints: chart.has_bands === true,
      axisLabelFontSize: 12,
      axisLineColor: style('--line'),
      gridLineColor: style('--grid'),
      digitsAfterDecimal: 6,
      xRangePad: 0,
      yRangePad: 8,
      includeZero: true,
      rightGap: 8,
      axes: {
        x: {valueFormatter: (time) => time.toFixed(3) + ' s'},
        y: {axisLabelWidth: 58, valueFormatter: (value) => value.toPrecision(6)},
      },
      underlayCallback: (context, area, dygraph) => drawBands(chart, context, area, dygraph),
      drawCallback: (dygraph, isInitial) => { if (!isInitial) follow(dygraph); },
    };
    chart.series.forEach((series) => {
      if (series.role === 'threshold') {
        options.series[series.label] = {strokePattern: [6, 4], drawPoints: false};
      }
    });
    const rows = rowsOf(chart, shown, columnsOf(element));
    options.valueRange = rangeOf(chart, rows, shown);
    const dygraph = new Dygraph(element, rows, options);
    charts.push({chart, element, dygraph});
  }

  // The lines in full, and of the thresholds what is nearest to zero: one that begins high above the
  // residual, while the plant's state is not known, must not press the residual flat.
  function rangeOf(chart, rows, window) {
    if (chart.has_bands === true) return null;
    let low = 0, high = 0;
    const nearest = chart.series.map(() => Infinity);
    for (const row of rows) {
      if (row[0] < window[0] || row[0] > window[1]) continue;
      chart.series.forEach((series, k) => {
        const value = row[k + 1];
        if (value === null || !Number.isFinite(value)) return;
        if (series.role === 'threshold') {
          if (Math.abs(value) < Math.abs(nearest[k])) nearest[k] = value;
        } else {
          low = Math.min(low, value);
          high = Math.max(high, value);
        }
      });
    }
    for (const value of nearest) {
      if (!Number.isFinite(value)) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    const margin = 0.06 * (high - low) || 1;
    return [low === 0 ? 0 : low - margin, high + margin];
  }

  let isShowing = false;
  // A chart was zoomed or dragged by hand: the others follow.
  function follow(dygraph) {
    if (isShowing) return;
    const range = dygraph.xAxisRange();
    if (Math.abs(range[0] - shown[0]) + Math.abs(range[1] - shown[1]) <
        1e-9 * (whole[1] - whole[0])) {
      return;
    }
    show(range[0], range[1]);
  }

  function show(from, until) {
    if (!(until > from)) return;
    shown = [Math.max(from, whole[0]), Math.min(until, whole[1])];
    if (!(shown[1] > shown[0])) shown = whole.slice();
    isShowing = true;
    for (const {chart, element, dygraph} of charts) {
      const rows = rowsOf(chart, shown, columnsOf(element));
      dygraph.updateOptions({
        file: rows,
        dateWindow: shown.slice(),
        valueRange: rangeOf(chart, rows, shown),
      });
    }
    isShowing = false;
    document.getElementById('from').value = shown[0].toFixed(3);
    document.getElementById('until').value = shown[1].toFixed(3);
  }

  function restyle() {
    isShowing = true;
    for (const {chart, dygraph} of charts) {
      dygraph.updateOptions({
        colors: colours(chart),
        axisLineColor: style('--line'),
        gridLineColor: style('--grid'),
      });
      dygraph.resize();
    }
    isShowing = false;
  }

  // One chart after the other, each in a task of its own: the page can be read and scrolled meanwhile.
  // All that are left before the page is printed.
  const waiting = Array.from(document.querySelectorAll('.chart'));
  function makeNext() {
    if (waiting.length === 0) return;
    make(waiting.shift());
    setTimeout(makeNext, 0);
  }
  function makeAll() {
    while (waiting.length > 0) make(waiting.shift());
  }
  makeNext();
  window.addEventListener('beforeprint', () => { makeAll(); restyle(); });
  window.addEventListener('afterprint', restyle);
  for (const query of ['print', '(prefers-color-scheme: dark)']) {
    window.matchMedia(query).addEventListener('change', () => {
      if (query === 'print') makeAll();
      restyle();
    });
  }

  const form = document.getElementById('window');
  if (form !== null) {
    form.hidden = page.charts.length === 0;
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      show(Number(document.getElementById('from').value),
        Number(document.getElementById('until').value));
    });
    document.getElementById('whole').addEventListener('click', () => show(whole[0], whole[1]));
    document.getElementById('stretch').addEventListener('change', (event) => {
      const [from, until] = event.target.value.split(' ').map(Number);
      const margin = 0.15 * (until - from) + 1e-6 * (whole[1] - whole[0]);
      if (event.target.value !== '') show(from - margin, until + margin);
    });
    document.getElementById('from').value = whole[0].toFixed(3);
    document.getElementById('until').value = whole[1].toFixed(3);
  }
  // For tests, and for whoever wants the numbers: the charts made so far, and how to show a window.
  window.faultlineReport = {page, charts, show, makeAll, load};
})();
