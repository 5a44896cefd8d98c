// One surface: positions of a frame, moved or not, and its colours.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  Group,
  Mesh,
  MeshLambertMaterial,
  SphereGeometry,
} from 'three';

const PLAIN = '#b9c0c9';
const ANCHOR = '#d01c1c';
const ANCHOR_RADIUS = 0.011; // of the diagonal

export class Surface {
  constructor(view) {
    this.view = view;
    this.geometry = new BufferGeometry();
    this.points = new Float32Array(3 * view.points);
    this.colours = new Float32Array(3 * view.points).fill(1);
    this.geometry.setAttribute('position', new BufferAttribute(this.points, 3));
    this.geometry.setAttribute('color', new BufferAttribute(this.colours, 3));
    this.geometry.setIndex(new BufferAttribute(view.faces, 1));
    const material = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide });
    this.mesh = new Mesh(this.geometry, material);
    // Every pose has another box.
    this.mesh.frustumCulled = false;
    this.anchors = new Group();
    const ball = new SphereGeometry(ANCHOR_RADIUS, 16, 12);
    const red = new MeshLambertMaterial({ color: ANCHOR });
    for (const point of view.anchors) {
      const anchor = new Mesh(ball, red);
      anchor.userData.point = point;
      this.anchors.add(anchor);
    }
    this.group = new Group();
    this.group.add(this.mesh, this.anchors);
  }

  /** Take the pose of a frame, with its displacements so many times as large. */
  pose(frame, magnify, colours) {
    this.#place(frame, magnify);
    this.#colour(frame, colours);
    this.geometry.computeVertexNormals();
    this.anchors.visible = colours === 'parts';
    for (const anchor of this.anchors.children) {
      anchor.position.fromArray(this.points, 3 * anchor.userData.point);
    }
  }

  #place(frame, magnify) {
    const { positions, reach, moves } = this.view;
    const n = this.points.length;
    const start = frame * n;
    for (let i = 0; i < n; i += 1) {
      this.points[i] = ((2 * positions[start + i]) / 65535 - 1) * reach;
    }
    if (magnify && moves) {
      const step = (magnify * moves.reach) / 127;
      for (let i = 0; i < n; i += 1) this.points[i] += step * moves.values[start + i];
    }
    this.geometry.attributes.position.needsUpdate = true;
  }

  #colour(frame, colours) {
    const { heat, parts, palette, points } = this.view;
    const some = colours === 'heat' && heat ? heat.colours : palette;
    const table = some.map((each) => new Color(each));
    const plain = new Color(PLAIN);
    for (let i = 0; i < points; i += 1) {
      let colour = plain;
      if (colours === 'heat' && heat) colour = table[heat.values[frame * points + i]];
      if (colours === 'parts') colour = table[parts[i] % table.length];
      colour.toArray(this.colours, 3 * i);
    }
    this.geometry.attributes.color.needsUpdate = true;
  }
}
