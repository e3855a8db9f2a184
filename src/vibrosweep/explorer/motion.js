// Shows all data of a message at once, without sending the changes back to a server.  `get` reads
// what Bokeh passes as a Map or an object.
const get = (from, key) => (from instanceof Map ? from.get(key) : from[key])
const show = (model, changes) => model.setv(changes, {sync: false})
const [content] = holder.data.content
for (const [name, source] of Object.entries(sources)) {
  const data = get(content, name)
  if (data) show(source, {data: data})
}
const views = get(content, "views")
if (views) {
  for (const [name, plot] of Object.entries(figures)) {
    const [x0, x1, y0, y1] = get(views, name)
    show(plot.x_range, {start: x0, end: x1, reset_start: x0, reset_end: x1})
    show(plot.y_range, {start: y0, end: y1, reset_start: y0, reset_end: y1})
  }
  const palette = get(content, "palette")
  show(particles, {palette: palette, high: palette.length - 0.5})
  show(heading, {text: get(content, "heading")})
  const [start, end] = get(views, "height")
  show(time, {start: start, end: end, value: Math.min(Math.max(time.value, start), end)})
}
if (time.value > time.start) time.properties.value.change.emit()  // the cursor in new data
