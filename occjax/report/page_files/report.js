// Draws the scenes of a report. The data of a scene are decoded when it comes near the screen.

const NO_VALUE = 65535;

function bytes(text) {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}

// Decode a map as occjax/report/scenes.py packs it: Float32Array, NaN for no value.
async function unpack(map, height, width) {
  const stream = new Blob([bytes(map.codes)]).stream();
  const inflated = stream.pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(inflated).arrayBuffer());
  const count = height * width;
  const values = new Float32Array(count);
  let first = 0;
  for (let y = 0, i = 0; y < height; y++) {
    let code = first;
    for (let x = 0; x < width; x++, i++) {
      const zigzag = (planes[i] << 8) | planes[count + i];
      code = (code + (zigzag & 1 ? -(zigzag + 1) / 2 : zigzag / 2)) & 65535;
      if (x === 0) first = code;
      values[i] = code === NO_VALUE ? NaN : map.low + map.scale * code;
    }
  }
  return values;
}

function colourOf(table, fraction) {
  const count = table.length / 3;
  const index = Math.min(count - 1, Math.max(0, Math.floor(fraction * count)));
  return table.subarray(3 * index, 3 * index + 3);
}

function drawMap(canvas, values, table, [low, high]) {
  const context = canvas.getContext("2d");
  const image = context.createImageData(canvas.width, canvas.height);
  const none = [1, 3, 5].map((at) => parseInt(COLOURS.none.slice(at, at + 2), 16));
  values.forEach((value, i) => {
    const colour = Number.isNaN(value) ? none : colourOf(table, (value - low) / (high - low));
    image.data.set([colour[0], colour[1], colour[2], 255], 4 * i);
  });
  context.putImageData(image, 0, 0);
}

function drawBar(canvas, table, [low, high], ticks) {
  const context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x++) {
    context.fillStyle = `rgb(${colourOf(table, (x + 0.5) / canvas.width)})`;
    context.fillRect(x, 0, 1, 1);
  }
  canvas.parentElement.querySelector(".ticks").append(
    ...ticks.map((tick) => {
      const mark = document.createElement("span");
      mark.textContent = tick.toFixed(2);
      mark.style.left = `${(100 * (tick - low)) / (high - low)}%`;
      return mark;
    })
  );
}

// Show the values of the pixel under the pointer, and mark it in all maps of the scene.
function readValues(section, data, maps) {
  const output = section.querySelector(".values");
  const places = [...section.querySelectorAll(".map")];
  const crosses = places.map((place) => {
    const cross = document.createElement("div");
    cross.className = "cross";
    cross.hidden = true;
    place.append(cross);
    return cross;
  });
  function show(event) {
    const box = event.currentTarget.getBoundingClientRect();
    const across = Math.min(0.9999, Math.max(0, (event.clientX - box.left) / box.width));
    const down = Math.min(0.9999, Math.max(0, (event.clientY - box.top) / box.height));
    const x = Math.floor(across * data.width);
    const y = Math.floor(down * data.height);
    const i = y * data.width + x;
    const parts = [`row ${y * data.step}, column ${x * data.step}`];
    for (const [name, digits] of [["disparity", 3], ["confidence", 2], ["error", 3]]) {
      if (!maps[name]) continue;
      const value = maps[name][i];
      parts.push(`${name} ${Number.isNaN(value) ? "none" : value.toFixed(digits)}`);
    }
    if (data.camera) {
      const inverse = data.camera.slope * maps.disparity[i] + data.camera.constant;
      if (!Number.isNaN(inverse)) parts.push(inverse > 0 ? `depth ${(1 / inverse).toFixed(3)} m` : "depth infinite");
    }
    output.textContent = parts.join(" \u00b7 ");
    for (const cross of crosses) {
      cross.hidden = false;
      cross.style.left = `${(100 * (x + 0.5)) / data.width}%`;
      cross.style.top = `${(100 * (y + 0.5)) / data.height}%`;
    }
  }
  for (const place of places) {
    place.addEventListener("pointermove", show);
    place.addEventListener("pointerdown", show);
  }
}

async function showOcclusion(section, occlusion) {
  const canvas = section.querySelector("[data-occlusion]");
  const sliders = [...section.querySelectorAll("[data-axis]")];
  const mosaic = new Image();
  mosaic.src = occlusion.image;
  await mosaic.decode();
  const [height, width] = occlusion.size;
  function draw() {
    const [v, u] = sliders.map((slider) => Number(slider.value));
    canvas.getContext("2d").drawImage(mosaic, u * width, v * height, width, height, 0, 0, width, height);
    const centre = v === occlusion.centre[0] && u === occlusion.centre[1] ? ", the estimated view" : "";
    section.querySelector(".view").textContent = `(${v}, ${u})${centre}`;
  }
  for (const slider of sliders) slider.addEventListener("input", draw);
  draw();
}

// Points of the pixels, as occjax.results.conversion.point_cloud computes them.
async function pointsOf(section, data, maps) {
  const picture = section.querySelector("img");
  await picture.decode();
  const { width, height } = data;
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d");
  context.drawImage(picture, 0, 0, width, height);
  const pixels = context.getImageData(0, 0, width, height).data;
  const step = Math.ceil(Math.sqrt((width * height) / data.max_points));
  const positions = [], colours = [], confidences = [];
  for (let y = 0; y < height; y += step) {
    for (let x = 0; x < width; x += step) {
      const i = y * width + x;
      const right = x - (width - 1) / 2, up = (height - 1) / 2 - y;
      const disparity = maps.disparity[i];
      if (Number.isNaN(disparity)) continue;
      if (data.camera) {
        const inverse = data.camera.slope * disparity + data.camera.constant;
        if (inverse <= 0) continue;
        const depth = 1 / inverse, focal = data.camera.focal_length;
        positions.push((right / focal) * depth, (up / focal) * depth, -depth);
      } else {
        positions.push(right, up, (disparity * Math.max(width, height)) / 8);
      }
      colours.push(pixels[4 * i], pixels[4 * i + 1], pixels[4 * i + 2]);
      confidences.push(maps.confidence[i]);
    }
  }
  return { positions, colours, confidences, step };
}

const VERTEX = `
attribute vec3 position; attribute vec3 colour; attribute float confidence;
uniform mat4 transform; uniform float scale; uniform float focal; uniform float least;
varying vec3 shade;
void main() {
  gl_Position = transform * vec4(position, 1.0);
  if (confidence < least) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  float spacing = focal > 0.0 ? -position.z / focal : 1.0;
  gl_PointSize = max(1.5, spacing * scale / gl_Position.w);
  shade = colour;
}`;

const FRAGMENT = `
precision mediump float; varying vec3 shade;
void main() { gl_FragColor = vec4(shade, 1.0); }`;

// Product of 4x4 matrices in WebGL's order of columns.
function multiply(a, b) {
  return a.map((_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (i % 4)] * b[4 * (i >> 2) + k], 0));
}

function median(values) {
  return values.length ? values.sort((a, b) => a - b)[values.length >> 1] : 0;
}

async function showPoints(section, data, maps) {
  const canvas = section.querySelector("[data-points]");
  const gl = canvas.getContext("webgl");
  if (!gl) {
    canvas.replaceWith("This browser has no WebGL, which draws the points.");
    return;
  }
  const { positions, colours, confidences, step } = await pointsOf(section, data, maps);
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  function attribute(name, array, size, type, normalized) {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
    const location = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalized, 0, 0);
  }
  attribute("position", new Float32Array(positions), 3, gl.FLOAT, false);
  attribute("colour", new Uint8Array(colours), 3, gl.UNSIGNED_BYTE, true);
  attribute("confidence", new Float32Array(confidences), 1, gl.FLOAT, false);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(0.125, 0.125, 0.125, 1);

  // The camera starts where the centre view was taken, or in front of the relief.
  const middle = median(positions.filter((_, i) => i % 3 === 2));
  const focal = data.camera ? data.camera.focal_length : 1.5 * Math.max(data.width, data.height);
  const tangent = Math.max(data.width, data.height) / 2 / focal;
  const distance = data.camera ? -middle : focal;
  const start = { turn: 0.25, tilt: 0.15, zoom: 1.1 };
  let camera = { ...start }, least = 0, asked = false;
  function draw() {
    asked = false;
    const side = Math.round(canvas.clientWidth * Math.min(2, window.devicePixelRatio));
    if (canvas.width !== side) canvas.width = canvas.height = side;
    gl.viewport(0, 0, side, side);
    const away = distance * camera.zoom, near = 0.02 * away, far = 100 * away;
    const [c, s] = [Math.cos(camera.turn), Math.sin(camera.turn)];
    const [k, t] = [Math.cos(camera.tilt), Math.sin(camera.tilt)];
    const projection = [
      1 / tangent, 0, 0, 0, 0, 1 / tangent, 0, 0,
      0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
    const tilt = [1, 0, 0, 0, 0, k, t, 0, 0, -t, k, 0, 0, 0, -away, 1];
    const turn = [c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, -s * middle, 0, -c * middle, 1];
    const uniform = (name) => gl.getUniformLocation(program, name);
    gl.uniformMatrix4fv(uniform("transform"), false, multiply(projection, multiply(tilt, turn)));
    gl.uniform1f(uniform("scale"), (1.3 * step * side) / 2 / tangent);
    gl.uniform1f(uniform("focal"), data.camera ? focal : 0);
    gl.uniform1f(uniform("least"), least);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawArrays(gl.POINTS, 0, positions.length / 3);
  }
  function redraw() {
    if (!asked) requestAnimationFrame(draw);
    asked = true;
  }
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const wide = pointers.size === 2 && spread();
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (wide) {
      camera.zoom *= wide / spread();
    } else {
      camera.turn += (3 * (event.clientX - before.x)) / canvas.clientWidth;
      camera.tilt += (3 * (event.clientY - before.y)) / canvas.clientWidth;
      camera.tilt = Math.max(-1.5, Math.min(1.5, camera.tilt));
    }
    redraw();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom *= Math.exp(event.deltaY / 600);
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    camera = { ...start };
    redraw();
  });
  section.querySelector("[data-confidence]").addEventListener("input", (event) => {
    least = Number(event.target.value);
    redraw();
  });
  new ResizeObserver(redraw).observe(canvas);
  draw();
}

async function showScene(section) {
  const data = JSON.parse(section.querySelector("script").textContent);
  const maps = {};
  for (const [name, map] of Object.entries(data.maps)) {
    maps[name] = await unpack(map, data.height, data.width);
    const limits = { disparity: data.limits, confidence: [0, 1], error: COLOURS.error_limits }[name];
    const ticks = name === "error" ? COLOURS.error_ticks : [limits[0], (limits[0] + limits[1]) / 2, limits[1]];
    const table = bytes(COLOURS[name]);
    drawMap(section.querySelector(`[data-map="${name}"]`), maps[name], table, limits);
    drawBar(section.querySelector(`[data-bar="${name}"]`), table, limits, ticks);
  }
  readValues(section, data, maps);
  if (data.occlusion) await showOcclusion(section, data.occlusion);
  await showPoints(section, data, maps);
  section.dataset.ready = "";
}

function sortable(table) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    heading.addEventListener("click", () => {
      const sign = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      for (const other of headings) other.removeAttribute("aria-sort");
      heading.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      const text = (row) => row.cells[column].textContent;
      const rows = [...table.tBodies[0].rows].sort((a, b) =>
        sign * text(a).localeCompare(text(b), undefined, { numeric: true }));
      // Decimal fractions are numbers, which localeCompare does not know.
      if (rows.every((row) => text(row) === "" || Number.isFinite(Number(text(row))))) {
        rows.sort((a, b) => sign * (Number(text(a)) - Number(text(b))));
      }
      // Scenes without the value come last in both directions.
      const isEmpty = (row) => text(row) === "";
      table.tBodies[0].append(...rows.filter((row) => !isEmpty(row)), ...rows.filter(isEmpty));
    });
  });
}

const nearby = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    nearby.unobserve(entry.target);
    showScene(entry.target);
  }
}, { rootMargin: "200px" });
for (const section of document.querySelectorAll("section")) nearby.observe(section);
const index = document.getElementById("index");
if (index) sortable(index);
